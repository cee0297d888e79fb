#pragma once

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/result.hpp"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Packets of the additional LiDARs that were merged into a scan; live, those that arrived in time.
struct MergeDecision {
  static constexpr std::size_t kMaxLidars = 3;
  /// False for a scan that is about to be superseded.
  bool merged = false;
  std::uint8_t lidars = 0;
  /// Packets of each LiDAR decoded or skipped since the start of its stream.
  std::array<std::uint64_t, kMaxLidars> packets{};
};

/// Decisions about one complete scan that depended on clocks and arrival times. With the same packets and
/// these decisions, a replay produces the same poses.
struct ScanDecision {
  std::uint64_t sequence = 0;  ///< scan number
  bool superseded = false;     ///< skipped because a newer scan was waiting
  bool guarded = false;        ///< the guard published its prediction, because registration was late
  /// IMU samples passed to the odometry before it registered the scan, counted from the start.
  std::uint64_t imu_samples = 0;
  core::BudgetDecisions budget;
  MergeDecision merge;
};

/// First line of a decision log.
struct DecisionHeader {
  core::BudgetMode budget_mode = core::BudgetMode::kOff;
  core::Duration budget;
  /// Files and folders of the recording, absolute; empty = those beside the decision log.
  std::vector<std::string> recording;
};

/// Lines of a decision log; JSON without line end.
std::string decision_line(const DecisionHeader& header);
std::string decision_line(const ScanDecision& decision);

/// Inputs that repeat a run.
struct RunToRepeat {
  std::string decisions;               ///< the decision log
  std::vector<std::string> recording;  ///< as --replay
  std::string configuration;           ///< as --config; empty: the recording's own
};
/// `path`: a decision log or the folder that contains it, written by --output or --record. Fails where the
/// recording is missing; the error says how to make one. With `has_recording`, only the decision log is
/// found.
core::Result<RunToRepeat> find_run_to_repeat(const std::string& path, bool has_recording);

/// Decisions of a log in order; the error names file, line and problem.
core::Result<std::vector<ScanDecision>> read_decisions(const std::string& path);

}  // namespace nilio::daemon
