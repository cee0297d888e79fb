#pragma once

#include <cstdint>
#include <string>

namespace nilio::drivers {

/// CAP_NET_ADMIN: without it libsocketcan only reads.
bool may_set_up_interfaces();

/// Stops the interface, sets bit rate and automatic restart, and starts it; one that the bit rate is refused
/// for is started again only if it was up. libsocketcan's error numbers are those of its own messages, so
/// what has come of it is to be seen by looking again. All of this may not come back: only for a thread that
/// can be left behind, and only for CAN interfaces.
void set_up_can_interface(const std::string& name, std::uint32_t bitrate, std::uint32_t restart_ms);

/// Takes a controller out of bus-off. Look again for the result.
void restart_can_controller(const std::string& name, const std::string& driver);

}  // namespace nilio::drivers
