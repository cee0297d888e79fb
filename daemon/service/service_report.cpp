#include "daemon/service/service_report.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdio>
#include <utility>

namespace nilio::daemon {

namespace {

constexpr std::int64_t kServiceStatusPeriodNs = 1'000'000'000;
constexpr double kNsPerMs = 1e6;

std::string microseconds(core::Duration time) { return std::to_string(time.ns / 1000); }

}  // namespace

ServiceReport::ServiceReport(const ServiceNotifier& notifier, std::int64_t started_ns)
    : notifier_(notifier), last_status_ns_(started_ns) {}

void ServiceReport::add(const ipc::PoseRecord& record) {
  if (!notifier_.is_connected()) return;
  state_ = record.state;
  ++poses_;
  const std::int64_t received = record.stage_time_ns(ipc::Stage::kReceived);
  const std::int64_t delivered = record.stage_time_ns(ipc::Stage::kDelivered);
  if (received != 0 && delivered != 0) latencies_ns_.push_back(delivered - received);
}

std::string ServiceReport::status(std::int64_t now_ns, const ServiceHealth& health) const {
  std::array<char, 120> text{};
  if (!is_ready_) {
    std::snprintf(text.data(), text.size(), "starting");
  } else if (poses_ == 0) {
    std::snprintf(text.data(), text.size(), "no poses");
  } else {
    const double seconds = static_cast<double>(now_ns - last_status_ns_) * 1e-9;
    const int length = std::snprintf(text.data(), text.size(), "%s, %.1f poses/s", core::name_of(state_),
                                     static_cast<double>(poses_) / seconds);
    if (!latencies_ns_.empty()) {
      std::vector<std::int64_t> sorted = latencies_ns_;
      std::sort(sorted.begin(), sorted.end());
      std::snprintf(text.data() + length, text.size() - static_cast<std::size_t>(length),
                    ", latency %.1f ms, at most %.1f ms",
                    static_cast<double>(sorted[sorted.size() / 2]) / kNsPerMs,
                    static_cast<double>(sorted.back()) / kNsPerMs);
    }
  }
  std::string line = text.data();
  for (const std::string& problem : health.problems) line += "; " + problem;
  if (!reload_outcome_.empty()) line += "; " + reload_outcome_;
  // The protocol ends a value at the end of its line.
  std::replace(line.begin(), line.end(), '\n', ' ');
  return line;
}

void ServiceReport::update(std::int64_t now_ns, const ServiceHealth& health) {
  if (!notifier_.is_connected()) return;
  const bool becomes_ready = !is_ready_ && health.is_ready;
  const core::Duration period = notifier_.ping_period();
  // A ping before READY would start the watchdog, which the time limit of the start replaces.
  const bool pings =
      period.ns > 0 && (is_ready_ || becomes_ready) && now_ns >= next_ping_ns_ && health.makes_progress;
  const bool has_status = becomes_ready || now_ns - last_status_ns_ >= kServiceStatusPeriodNs;
  if (!pings && !has_status) return;
  is_ready_ = is_ready_ || becomes_ready;
  std::string message;
  if (becomes_ready) message += "READY=1\n";
  if (pings) message += "WATCHDOG=1\n";
  if (has_status) message += "STATUS=" + status(now_ns, health) + '\n';
  // The next update repeats a message that was not delivered.
  if (!notifier_.send(message)) {
    is_ready_ = is_ready_ && !becomes_ready;
  } else if (pings) {
    next_ping_ns_ = now_ns + period.ns;
  }
  if (!has_status) return;
  last_status_ns_ = now_ns;
  latencies_ns_.clear();
  poses_ = 0;
}

void ServiceReport::begin_reload(std::int64_t now_ns) {
  // Type=notify-reload of systemd 253 needs the time; older versions ignore it.
  if (is_ready_)
    static_cast<void>(notifier_.send("RELOADING=1\nMONOTONIC_USEC=" + std::to_string(now_ns / 1000) + '\n'));
}

void ServiceReport::end_reload(std::string outcome) {
  reload_outcome_ = std::move(outcome);
  // With the next update, which repeats it until it is delivered.
  is_ready_ = false;
}

void ServiceReport::stop(core::Duration patience) {
  std::string message = "STOPPING=1\nSTATUS=finishing files\nEXTEND_TIMEOUT_USEC=" + microseconds(patience);
  // Nobody feeds the watchdog from now on.
  if (notifier_.ping_period().ns > 0) message += "\nWATCHDOG_USEC=" + microseconds(patience);
  static_cast<void>(notifier_.send(message + '\n'));
}

}  // namespace nilio::daemon
