#pragma once

#include "daemon/service/service_notifier.hpp"
#include "ipc/records.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace nilio::daemon {

/// State of a run as the service manager is told.
struct ServiceHealth {
  /// Sensors are bound, threads run, and the publisher is up or not configured.
  bool is_ready = false;
  /// Every thread makes progress, and poses are computed or the log tells why not.
  bool makes_progress = false;
  /// Short phrases, the most important first.
  std::vector<std::string> problems;
};

/// Reports a run to the service manager: readiness, watchdog, and once a second a status line such as
/// "tracking, 10.0 poses/s, latency 21 ms, at most 25 ms; nilio-publisher does not run". One thread.
class ServiceReport {
 public:
  /// `notifier` must outlive the report. `started_ns`: CLOCK_MONOTONIC, as all times here.
  ServiceReport(const ServiceNotifier& notifier, std::int64_t started_ns);

  void add(const ipc::PoseRecord& record);
  /// Sends what is due; call several times per ping period. The watchdog is fed while progress is made.
  void update(std::int64_t now_ns, const ServiceHealth& health);
  /// Around a reload of the configuration; `outcome` stays in the status line, empty: nothing to tell.
  void begin_reload(std::int64_t now_ns);
  void end_reload(std::string outcome);
  /// Call before files are finished, which takes at most `patience`.
  void stop(core::Duration patience);

 private:
  [[nodiscard]] std::string status(std::int64_t now_ns, const ServiceHealth& health) const;

  const ServiceNotifier& notifier_;
  bool is_ready_ = false;
  std::int64_t next_ping_ns_ = 0;
  std::int64_t last_status_ns_;
  std::string reload_outcome_;
  // Poses since the last status line.
  ipc::TrackingState state_ = ipc::TrackingState::kInitialising;
  std::vector<std::int64_t> latencies_ns_;
  std::uint64_t poses_ = 0;
};

}  // namespace nilio::daemon
