#include "drivers/can/can_monitor.hpp"

#include <algorithm>
#include <linux/can/netlink.h>
#include <utility>

namespace nilio::drivers {
namespace {

constexpr std::int64_t kMillisecondNs = 1'000'000;
constexpr std::int64_t kShortestWaitNs = 100 * kMillisecondNs;
constexpr std::int64_t kLongestWaitNs = 5'000 * kMillisecondNs;
/// After this time without bus-off the restart waits begin short again.
constexpr std::int64_t kRecoveredNs = 10'000 * kMillisecondNs;
/// An improvement is reported after this time: on a broken bus each restart gives some good milliseconds.
constexpr std::int64_t kLastingNs = 500 * kMillisecondNs;
constexpr std::int64_t kMissedReportPeriodNs = 5'000 * kMillisecondNs;
constexpr const char* kCheckBus = "check bit rate, wiring and the 120 ohm at both ends";

bool has_counted_errors(CanBusState state) {
  return state >= CanBusState::kErrorWarning && state <= CanBusState::kBusOff;
}

/// True for improvements that may be short-lived: both states have a running controller.
bool may_be_transient(CanBusState from, CanBusState to) {
  return has_counted_errors(from) && to < from && to >= CanBusState::kUp;
}

std::string times(std::uint64_t count) { return count == 1 ? "once" : std::to_string(count) + " times"; }

}  // namespace

std::string_view name_of(CanBusState state) {
  switch (state) {
    case CanBusState::kUnknown:
      return "unknown";
    case CanBusState::kUp:
      return "up";
    case CanBusState::kErrorActive:
      return "error-active";
    case CanBusState::kErrorWarning:
      return "error-warning";
    case CanBusState::kErrorPassive:
      return "error-passive";
    case CanBusState::kBusOff:
      return "bus-off";
    case CanBusState::kUnanswered:
      return "unanswered";
    case CanBusState::kDown:
      return "down";
    case CanBusState::kGone:
      return "gone";
  }
  return "unknown";
}

CanBusState classify(const CanInterfaceState& seen) {
  if (!seen.present || !seen.is_can) return CanBusState::kGone;
  if (!seen.up) return CanBusState::kDown;
  if (seen.silent) return CanBusState::kUnanswered;
  if (!seen.controller) return CanBusState::kUp;
  switch (*seen.controller) {
    case CAN_STATE_ERROR_WARNING:
      return CanBusState::kErrorWarning;
    case CAN_STATE_ERROR_PASSIVE:
      return CanBusState::kErrorPassive;
    case CAN_STATE_BUS_OFF:
      return CanBusState::kBusOff;
    case CAN_STATE_STOPPED:
    case CAN_STATE_SLEEPING:
      return CanBusState::kDown;
    default:
      return CanBusState::kErrorActive;
  }
}

CanMonitor::CanMonitor(CanControllerConfig config, bool privileged)
    : config_(std::move(config)), privileged_(privileged), restart_wait_ns_(kShortestWaitNs) {}

void CanMonitor::report(bool problem, const std::string& text) {
  events_.push_back({problem, "CAN " + config_.interface_name + ": " + text});
}

std::vector<CanEvent> CanMonitor::take_events() { return std::exchange(events_, {}); }

CanMonitor::Action CanMonitor::observe(const CanInterfaceState& seen, std::int64_t now_ns) {
  const CanBusState before = std::exchange(status_.state, classify(seen));
  count_absences(seen, before);
  count_bus_offs(seen, before);
  if (const Action action = set_up_action(seen); action != Action::kNone) return action;
  report_change(seen, now_ns);
  report_missed_bus_offs(now_ns);
  return restart_action(seen, now_ns);
}

/// Counts down and gone states after the first reading. An adapter that was replaced between two readings has
/// another number.
void CanMonitor::count_absences(const CanInterfaceState& seen, CanBusState before) {
  const bool known = before != CanBusState::kUnknown;
  if (known && status_.state != before && status_.state == CanBusState::kGone) ++status_.times_gone;
  if (known && before < CanBusState::kDown && seen.is_can && !seen.up) ++status_.times_down;
  if (!seen.is_can) return;
  if (before != CanBusState::kGone && index_ != 0 && seen.index != index_) {
    ++status_.times_gone;
    report(true, "was gone and is back");
  }
  index_ = seen.index;
}

/// The driver also counts bus-offs between two readings; a new interface begins at 0.
void CanMonitor::count_bus_offs(const CanInterfaceState& seen, CanBusState before) {
  std::uint64_t more = status_.state == CanBusState::kBusOff && before != CanBusState::kBusOff ? 1 : 0;
  if (seen.bus_offs) {
    const std::uint32_t last = driver_bus_offs_.value_or(*seen.bus_offs);
    more = std::max<std::uint64_t>(*seen.bus_offs >= last ? *seen.bus_offs - last : *seen.bus_offs,
                                   driver_bus_offs_ ? 0 : more);
    driver_bus_offs_ = seen.bus_offs;
  }
  status_.bus_offs += more;
  unreported_bus_offs_ += more;
}

CanMonitor::Action CanMonitor::set_up_action(const CanInterfaceState& seen) {
  if (!seen.present || !seen.is_can || seen.silent) return Action::kNone;
  if (config_.bitrate == 0 || seen.index == set_up_index_) return Action::kNone;
  set_up_index_ = seen.index;
  if (seen.up && runs_at(seen, config_.bitrate) && seen.restart_ms == config_.restart_ms)
    return Action::kNone;
  if (!seen.controller) {
    report(false, "a virtual bus has no bit rate; the configured one is ignored");
    return Action::kNone;
  }
  if (privileged_) return Action::kSetUp;
  if (seen.up && runs_at(seen, config_.bitrate)) return Action::kNone;
  const std::string now =
      seen.bitrate ? "its bit rate is " + std::to_string(*seen.bitrate) + " bit/s" : "it is down";
  if (!std::exchange(privilege_missed_, true))
    report(true, now + ", and without CAP_NET_ADMIN nilio cannot set it up; as root: 'ip link set " +
                     config_.interface_name + " down; ip link set " + config_.interface_name +
                     " up type can bitrate " + std::to_string(config_.bitrate) + "'");
  return Action::kNone;
}

void CanMonitor::set_up_result(const CanInterfaceState& after) {
  if (!after.present) return;
  const std::string wanted = std::to_string(config_.bitrate) + " bit/s";
  if (!after.up) {
    report(true,
           "cannot be set to " + wanted +
               " and started; give the bit rate of the bus, often 500000, 250000 or 1000000, and see the "
               "kernel log (dmesg)");
    return;
  }
  if (!runs_at(after, config_.bitrate)) {
    report(true, "its controller cannot do " + wanted +
                     "; give the bit rate of the bus, often 500000, 250000 or 1000000");
  } else {
    report(false, "set to " + std::to_string(*after.bitrate) + " bit/s and started" +
                      (after.bitrate == config_.bitrate ? "" : ", the nearest that it can do to " + wanted));
  }
  if (after.restart_ms.value_or(0) != config_.restart_ms)
    report(false, "its driver has no automatic restart; nilio stops and starts it after bus-off");
}

CanMonitor::Action CanMonitor::restart_action(const CanInterfaceState& seen, std::int64_t now_ns) {
  if (status_.state != CanBusState::kBusOff) {
    restart_due_ns_.reset();
    if (!good_since_ns_) good_since_ns_ = now_ns;
    if (now_ns - *good_since_ns_ >= kRecoveredNs) restart_wait_ns_ = kShortestWaitNs;
    return Action::kNone;
  }
  good_since_ns_.reset();
  if (!privileged_ || seen.restart_ms.value_or(0) > 0) return Action::kNone;
  if (!restart_due_ns_) restart_due_ns_ = now_ns + restart_wait_ns_;
  if (now_ns < *restart_due_ns_) return Action::kNone;
  restart_wait_ns_ = std::min(2 * restart_wait_ns_, kLongestWaitNs);
  restart_due_ns_ = now_ns + restart_wait_ns_;
  ++status_.restarts;
  ++unreported_restarts_;
  return Action::kRestart;
}

/// Reports a worse state at once, a better one when it has lasted.
void CanMonitor::report_change(const CanInterfaceState& seen, std::int64_t now_ns) {
  if (status_.state == reported_) {
    better_since_ns_.reset();
    return;
  }
  const bool starting = status_.state == CanBusState::kDown && seen.up;
  if (starting || may_be_transient(reported_, status_.state)) {
    if (!better_since_ns_) better_since_ns_ = now_ns;
    if (now_ns - *better_since_ns_ < kLastingNs) return;
  }
  better_since_ns_.reset();
  const CanBusState before = std::exchange(reported_, status_.state);
  std::string text = describe(seen);
  if (before == CanBusState::kBusOff && status_.state < CanBusState::kBusOff) {
    text += " again after " + times(unreported_bus_offs_ + 1) + " bus-off";
    if (unreported_restarts_ > 0) text += ", restarted " + times(unreported_restarts_) + " by nilio";
  } else if (before == CanBusState::kGone) {
    text = "back, " + text;
  }
  unreported_bus_offs_ = 0;
  unreported_restarts_ = 0;
  missed_reported_ns_ = now_ns;
  report(status_.state > CanBusState::kErrorActive, text);
}

/// Reports bus-offs between two readings, of controllers that restart themselves.
void CanMonitor::report_missed_bus_offs(std::int64_t now_ns) {
  if (unreported_bus_offs_ == 0 || reported_ >= CanBusState::kBusOff) return;
  if (status_.state != reported_ || now_ns - missed_reported_ns_ < kMissedReportPeriodNs) return;
  missed_reported_ns_ = now_ns;
  report(true,
         "was bus-off " + times(std::exchange(unreported_bus_offs_, 0)) + " for a short time; " + kCheckBus);
}

std::string CanMonitor::describe(const CanInterfaceState& seen) const {
  switch (status_.state) {
    case CanBusState::kBusOff:
      return std::string("bus-off: the controller has given up after too many errors; ") + kCheckBus + "; " +
             describe_recovery(seen);
    case CanBusState::kErrorWarning:
    case CanBusState::kErrorPassive:
      return std::string(name_of(status_.state)) + ": there are errors on the bus; " + kCheckBus;
    case CanBusState::kGone:
      if (seen.present) return "is no CAN interface; waiting for one of this name";
      break;
    default:
      break;
  }
  return describe_can_interface(config_.interface_name, seen);
}

std::string CanMonitor::describe_recovery(const CanInterfaceState& seen) const {
  if (seen.restart_ms.value_or(0) > 0)
    return "it restarts itself after " + std::to_string(*seen.restart_ms) + " ms";
  if (privileged_) return "nilio restarts it";
  return "without CAP_NET_ADMIN nilio cannot restart it; as root: 'ip link set " + config_.interface_name +
         " type can restart'";
}

}  // namespace nilio::drivers
