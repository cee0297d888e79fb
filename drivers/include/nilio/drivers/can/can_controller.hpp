#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::drivers {

/// State of a CAN interface, from good to bad.
enum class CanBusState {
  kUnknown,       ///< not looked at yet
  kUp,            ///< a virtual bus: there is no controller that could have errors
  kErrorActive,   ///< a controller that works
  kErrorWarning,  ///< more than 96 errors counted
  kErrorPassive,  ///< more than 127: it no longer disturbs others
  kBusOff,        ///< more than 255: it neither sends nor receives
  kUnanswered,    ///< the driver does not answer
  kDown,          ///< switched off
  kGone,          ///< no such interface, or none of CAN
};

/// "error-active", as ip link prints it.
std::string_view name_of(CanBusState state);

struct CanControllerConfig {
  std::string interface_name;
  /// bit/s; 0 = leave the interface as it is. Otherwise it is stopped, set and started when it is first seen
  /// or plugged in again and has another bit rate or is down.
  std::uint32_t bitrate = 0;
  /// Set with the bit rate: the controller restarts itself so long after bus-off; 0 = it is restarted from
  /// here.
  std::uint32_t restart_ms = 0;
};

/// A line for the log, once per change.
struct CanEvent {
  bool problem = false;
  std::string message;
};

/// Totals since the watch began. The driver's own count of bus-offs is used where it has one, so that short
/// ones between two looks are not missed.
struct CanControllerStatus {
  CanBusState state = CanBusState::kUnknown;
  std::uint64_t bus_offs = 0;
  std::uint64_t restarts = 0;  ///< made from here
  std::uint64_t times_down = 0;
  std::uint64_t times_gone = 0;
};

/// Looks after a CAN interface ten times a second on a thread of its own: tells each change of its state,
/// sets the bit rate when asked, and takes a controller out of bus-off with waits from 0.1 s doubling to 5 s,
/// by a restart or, where the driver has none, by stopping and starting. An interface that is not there is
/// waited for. Reading needs no privilege; what would need CAP_NET_ADMIN and is not to be had is said once,
/// with the command that does it. Settings go through libsocketcan, states are read by rtnetlink.
///
/// A thread that the kernel keeps longer than 10 s is left behind, and another takes over. One thread calls
/// the members; none of them waits longer than 0.3 s.
class CanController {
 public:
  /// Fails for a name that no interface can have, and for an interface that is not of CAN: stopping it could
  /// cut off the network.
  static core::Result<std::unique_ptr<CanController>> watch(const CanControllerConfig& config);
  CanController(const CanController&) = delete;
  CanController& operator=(const CanController&) = delete;
  ~CanController();

  /// What has happened since the last call. Does not wait.
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
