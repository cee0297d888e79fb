#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace nilio::drivers {

/// What the kernel tells of an interface.
struct CanInterfaceState {
  bool present = false;
  /// ARPHRD_CAN. Nothing else may be given to libsocketcan: it would stop a network card, too.
  bool is_can = false;
  bool up = false;
  /// The kernel has not answered in time.
  bool silent = false;
  unsigned index = 0;
  std::string driver{};
  /// enum can_state, bit/s, ms and the driver's count; nothing for virtual interfaces.
  std::optional<int> controller{};
  std::optional<std::uint32_t> bitrate{};
  std::optional<std::uint32_t> restart_ms{};
  std::optional<std::uint32_t> bus_offs{};
};

/// True when the controller runs at this bit rate, as near as its clock allows: the kernel takes up to 5 %
/// off.
bool runs_at(const CanInterfaceState& state, std::uint32_t bitrate);

/// Waits for the kernel, which a driver in trouble can keep busy: not for real-time threads.
CanInterfaceState look_at_can_interface(const std::string& name);

/// The same, waiting at most 0.3 s. Any thread.
CanInterfaceState query_can_interface(const std::string& name);

/// "up, error-active, 500000 bit/s", and the command that helps where something is wrong.
std::string describe_can_interface(const std::string& name, const CanInterfaceState& state);

}  // namespace nilio::drivers
