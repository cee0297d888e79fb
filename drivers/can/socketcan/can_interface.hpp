#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace nilio::drivers {

/// State of a CAN interface as the kernel reports it.
struct CanInterfaceState {
  bool present = false;
  /// ARPHRD_CAN. Never pass another interface to libsocketcan: it would stop a network card, too.
  bool is_can = false;
  bool up = false;
  /// The driver did not answer in time.
  bool silent = false;
  unsigned index = 0;
  std::string driver{};
  /// enum can_state, bit/s, ms and the driver's count; nothing for virtual interfaces.
  std::optional<int> controller{};
  std::optional<std::uint32_t> bitrate{};
  std::optional<std::uint32_t> restart_ms{};
  std::optional<std::uint32_t> bus_offs{};
};

/// True when the controller runs at this bit rate within 5 %, the deviation that the kernel allows for its
/// clock.
bool runs_at(const CanInterfaceState& state, std::uint32_t bitrate);

/// Reads the state. A driver in trouble can block this call: not for real-time threads.
CanInterfaceState read_can_interface(const std::string& name);
/// The same, but returns after 0.3 s at the latest. Any thread.
CanInterfaceState query_can_interface(const std::string& name);

/// "up, error-active, 500000 bit/s", with the command that helps in case of a fault.
std::string describe_can_interface(const std::string& name, const CanInterfaceState& state);

/// True with CAP_NET_ADMIN; libsocketcan can only read without it.
bool may_set_up_interfaces();

/// Stops the interface, sets bit rate and automatic restart, and starts it. An interface whose driver refuses
/// the bit rate is started again only if it was up. libsocketcan's return values are unreliable: read the
/// state again for the result. This call may block for ever: only for a thread that can be abandoned, and
/// only for CAN interfaces.
void set_up_can_interface(const std::string& name, std::uint32_t bitrate, std::uint32_t restart_ms);

/// Takes a controller out of bus-off. May block as set_up_can_interface(); read the state for the result.
void restart_can_controller(const std::string& name, const std::string& driver);

}  // namespace nilio::drivers
