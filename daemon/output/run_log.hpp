#pragma once

#include "daemon/odometry/pipeline.hpp"
#include "daemon/output/run_output.hpp"
#include "daemon/output/run_reports.hpp"
#include "daemon/output/run_result.hpp"
#include "ipc/histogram.hpp"
#include "ipc/records.hpp"

#include <cstdint>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace nilio::daemon {

/// Statistics of a run and their log lines: state and time source of the poses, IMU, latency, budget. Used by
/// the supervisor's thread; only logs and counts, so that it never blocks.
class RunLog {
 public:
  /// At full speed scans wait for each other by intention, so that only processing times mean anything.
  explicit RunLog(bool full_speed) : full_speed_(full_speed) {}

  void add(const ipc::PoseRecord& record);
  void add(const core::ImuHealth& health) { imu_.update(health); }
  /// Outcomes of the requests to the kernel. `live`: those granted are worth a line, too.
  void add(const std::vector<PlanOutcome>& outcomes, bool live);
  /// One line about the newest pose; nothing if there is none since the last call.
  void report_status();
  /// Lines at the end of a run. Call after Pipeline::join().
  void report_end(const Pipeline& pipeline, double seconds) const;
  /// Content of latency.json but for the counters of other processes. Call after Pipeline::join().
  [[nodiscard]] nlohmann::json summary(const Pipeline& pipeline) const;
  /// Distribution of each latency stage, by file name.
  [[nodiscard]] RunOutput::FinalFiles latency_files() const;

  [[nodiscard]] const RunTotals& totals() const { return totals_; }

 private:
  void report_state(const ipc::PoseRecord& record);
  void report_reset(const ipc::PoseRecord& record, ipc::OdometryReset reset) const;
  void report_stages() const;
  [[nodiscard]] std::string median_latency() const;
  void report_unused_imu(const Pipeline& pipeline) const;

  bool full_speed_;
  ipc::LatencyHistograms latency_;
  BudgetReport budget_;
  ImuReport imu_;
  /// Outcomes of the requests to the kernel, one line each.
  std::vector<std::string> plan_lines_;
  RunTotals totals_;
  std::uint64_t poses_at_last_status_ = 0;
  ipc::TrackingState reported_state_ = ipc::TrackingState::kInitialising;
};

}  // namespace nilio::daemon
