#pragma once

#include "nilio/drivers/can/can_controller.hpp"

#include "drivers/can/socketcan/can_interface.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::drivers {

/// State of the interface, in the classes of the public header.
CanBusState classify(const CanInterfaceState& seen);

/// Decides from successive states of an interface which changes to report and which action to take. Uses
/// neither the kernel nor a clock. One thread.
class CanMonitor {
 public:
  enum class Action {
    kNone,
    kSetUp,    ///< set_up_can_interface(), then set_up_result()
    kRestart,  ///< restart_can_controller()
  };

  CanMonitor(CanControllerConfig config, bool privileged);

  /// Evaluates a reading at the monotonic time `now_ns`.
  Action observe(const CanInterfaceState& seen, std::int64_t now_ns);
  /// Reports the result of Action::kSetUp.
  void set_up_result(const CanInterfaceState& after);

  std::vector<CanEvent> take_events();
  [[nodiscard]] const CanControllerStatus& status() const { return status_; }

 private:
  void report(bool problem, const std::string& text);
  [[nodiscard]] Action set_up_action(const CanInterfaceState& seen);
  [[nodiscard]] Action restart_action(const CanInterfaceState& seen, std::int64_t now_ns);
  void count_absences(const CanInterfaceState& seen, CanBusState before);
  void count_bus_offs(const CanInterfaceState& seen, CanBusState before);
  void report_change(const CanInterfaceState& seen, std::int64_t now_ns);
  void report_missed_bus_offs(std::int64_t now_ns);
  [[nodiscard]] std::string describe(const CanInterfaceState& seen) const;
  [[nodiscard]] std::string describe_recovery(const CanInterfaceState& seen) const;

  const CanControllerConfig config_;
  const bool privileged_;
  CanControllerStatus status_;
  std::vector<CanEvent> events_;
  CanBusState reported_ = CanBusState::kUnknown;
  /// Start of an improvement that is not reported yet.
  std::optional<std::int64_t> better_since_ns_;
  unsigned index_ = 0;
  unsigned set_up_index_ = 0;
  bool privilege_missed_ = false;
  std::optional<std::uint32_t> driver_bus_offs_;
  std::uint64_t unreported_bus_offs_ = 0;
  std::uint64_t unreported_restarts_ = 0;
  std::int64_t missed_reported_ns_ = 0;
  std::optional<std::int64_t> restart_due_ns_;
  std::optional<std::int64_t> good_since_ns_;
  std::int64_t restart_wait_ns_;
};

}  // namespace nilio::drivers
