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

/// First line of a decision log, and one line of it; JSON without line end.
std::string decision_header(core::BudgetMode mode, double budget_ms);
std::string decision_line(const ScanDecision& decision);

/// Decisions of a log in order; the error names file, line and problem.
core::Result<std::vector<ScanDecision>> read_decisions(const std::string& path);

}  // namespace nilio::daemon
