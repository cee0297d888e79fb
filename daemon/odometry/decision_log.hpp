#pragma once

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/result.hpp"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Which packets of the LiDARs beside the first went into a scan: live, what had come when it could wait no
/// longer.
struct MergeDecision {
  static constexpr std::size_t kMaxLidars = 3;
  /// A scan that is about to be superseded is not merged at all.
  bool merged = false;
  std::uint8_t lidars = 0;
  /// Of each LiDAR's packets, from the beginning of its stream, those that were decoded or skipped by then.
  std::array<std::uint64_t, kMaxLidars> packets{};
};

/// What was decided about one complete scan by clocks and arrival, not by data. With the same packets and
/// these, a replay gives the same poses as the run that decided.
struct ScanDecision {
  std::uint64_t sequence = 0;  ///< of the scan
  bool superseded = false;     ///< a newer one was waiting: this one was left out
  bool guarded = false;        ///< its prediction was published, because registration was late
  /// IMU samples that the odometry had been given, from the beginning, before it registered the scan.
  std::uint64_t imu_samples = 0;
  core::BudgetDecisions budget;
  MergeDecision merge;
};

/// First line of a decision log, and one line of it; JSON, without the end of line.
std::string decision_header(core::BudgetMode mode, double budget_ms);
std::string decision_line(const ScanDecision& decision);

/// The decisions of a log, in order; fails naming file, line and what is wrong with it.
core::Result<std::vector<ScanDecision>> read_decisions(const std::string& path);

}  // namespace nilio::daemon
