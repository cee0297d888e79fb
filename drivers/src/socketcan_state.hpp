#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace nilio::drivers {

/// What the kernel tells of an interface.
struct CanInterfaceState {
  bool present = false;
  bool up = false;
  /// The driver was asked before and has not answered: libsocketcan waits for ever for a device that was
  /// unplugged at the wrong moment.
  bool silent = false;
  /// enum can_state and bit/s; nothing for virtual interfaces.
  std::optional<int> controller;
  std::optional<std::uint32_t> bitrate;
};

/// Waits at most 0.3 s. Any thread.
CanInterfaceState query_can_interface(const std::string& name);

/// "up, error-active, 500000 bit/s", and the command that helps where something is wrong.
std::string describe_can_interface(const std::string& name, const CanInterfaceState& state);

}  // namespace nilio::drivers
