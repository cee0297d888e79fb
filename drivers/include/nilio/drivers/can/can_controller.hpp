#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::drivers {

/// State of a CAN interface, in order of severity.
enum class CanBusState {
  kUnknown,       ///< not read yet
  kUp,            ///< a virtual bus, which has no controller
  kErrorActive,   ///< controller without trouble
  kErrorWarning,  ///< more than 96 errors
  kErrorPassive,  ///< more than 127 errors: sends no active error flags
  kBusOff,        ///< more than 255 errors: neither sends nor receives
  kUnanswered,    ///< the driver does not answer
  kDown,          ///< interface switched off
  kGone,          ///< no such interface, or not CAN
};

/// "error-active", as ip link prints it.
std::string_view name_of(CanBusState state);

struct CanControllerConfig {
  std::string interface_name;
  /// bit/s; 0 = leave the interface as it is. Otherwise the interface is stopped, set and started when it
  /// first appears, or appears again, with another bit rate or down.
  std::uint32_t bitrate = 0;
  /// Delay of the controller's own restart after bus-off, ms, set with the bit rate; 0 = CanController
  /// restarts it.
  std::uint32_t restart_ms = 0;
};

/// A log line; one for each change of state.
struct CanEvent {
  bool problem = false;
  std::string message;
};

/// Totals since watch(). Bus-offs are the driver's own count where it has one, which includes short ones
/// between two readings.
struct CanControllerStatus {
  CanBusState state = CanBusState::kUnknown;
  std::uint64_t bus_offs = 0;
  std::uint64_t restarts = 0;  ///< by CanController
  std::uint64_t times_down = 0;
  std::uint64_t times_gone = 0;
};

/// Watches a CAN interface ten times a second on a thread of its own: reports each change of state, sets the
/// bit rate if configured, and takes a controller out of bus-off with waits from 0.1 s doubling to 5 s, by a
/// restart or, where the driver has none, by stopping and starting. Waits for a missing interface. Reading
/// needs no privilege; a lack of CAP_NET_ADMIN is reported once, with the command to run as root. Settings go
/// through libsocketcan, states are read by rtnetlink.
///
/// A thread that the kernel blocks for more than 10 s is abandoned and replaced. One thread calls the
/// members; none of them waits longer than 0.3 s.
class CanController {
 public:
  /// Fails for an invalid interface name, and for an interface that is not CAN: stopping it could cut off the
  /// network.
  static core::Result<std::unique_ptr<CanController>> watch(const CanControllerConfig& config);
  CanController(const CanController&) = delete;
  CanController& operator=(const CanController&) = delete;
  ~CanController();

  /// Events since the last call. Does not wait.
  std::vector<CanEvent> take_events();
  [[nodiscard]] CanControllerStatus status() const;

 private:
  struct Shared;
  explicit CanController(std::shared_ptr<Shared> shared);
  void start_helper();
  static void run(const std::shared_ptr<Shared>& shared, unsigned generation);

  std::shared_ptr<Shared> shared_;
};

}  // namespace nilio::drivers
