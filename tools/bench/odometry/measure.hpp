#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/odometry/consistency.hpp"
#include "tools/bench/odometry/run.hpp"
#include "tools/evaluate/metrics.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools {

/// How far a trajectory is from the truth.
struct Accuracy {
  /// Mean over the segments of 10 to 80 m and of 100 to 800 m; nothing where the path is shorter.
  std::optional<SegmentError> near;
  std::optional<SegmentError> far;
  double ape_m = 0.0;  ///< rmse after SE(3) alignment
  double rpe_m = 0.0;  ///< rmse from scan to scan
  double rpe_deg = 0.0;
  double end_drift_percent = 0.0;
  double truth_length_m = 0.0;
  double estimate_length_m = 0.0;
};

core::Result<Accuracy> judge_trajectory(const Trajectory& truth, const Trajectory& estimate);

struct Spread {
  double median = 0.0;
  double p99 = 0.0;
  double max = 0.0;
};

/// All zero for no values; p99 is the smallest value that 99 % do not exceed.
Spread spread_of(std::vector<double> values);

/// Filter (with prediction, deskewing and selection), coarse and fine registration, map update.
inline constexpr std::size_t kStages = 4;
inline constexpr std::size_t kCoarseStage = 1;
inline constexpr std::size_t kFineStage = 2;
const char* stage_name(std::size_t stage);

/// Milliseconds a scan.
struct StageTimes {
  Spread total;
  /// From the end of the scan before: with the decoding of packets (or the reading of a KITTI file) into the
  /// scan, and what the odometry thread does with a pose. Of a clock that stands while the thread waits only.
  Spread with_feed;
  std::array<Spread, kStages> stages;
  std::vector<double> per_scan;  ///< totals, in order
};

/// What the odometry had to do, means per scan.
struct WorkCounts {
  std::size_t scans = 0;
  std::size_t predicted = 0;  ///< scans whose registration was not accepted
  std::uint64_t with_imu = 0;
  double passes = 0.0;
  double coarse_iterations = 0.0;
  double fine_iterations = 0.0;
  double points = 0.0;
  double points_filtered = 0.0;
  double points_used = 0.0;
  double correspondences = 0.0;
  double map_voxels = 0.0;
};

struct Measurement {
  std::string name;
  int threads = 1;
  Accuracy accuracy;
  Consistency consistency;
  StageTimes wall;
  StageTimes cpu;
  WorkCounts work;
  /// operator new by the odometry thread inside register_scan: during the first kWarmUpScans, and per scan
  /// afterwards.
  std::int64_t allocations_warming_up = 0;
  double allocations_per_scan = 0.0;
  std::uint64_t peak_resident_bytes = 0;
  std::uint64_t resident_before_bytes = 0;
  std::string sha256;
  Trajectory trajectory;
};

inline constexpr std::size_t kWarmUpScans = 10;

/// Runs the data set under `overrides`: for wall time, for CPU time and for allocations, each so often as
/// `repeats` says, of which the least time of each scan counts. An error when two of the runs differ in a
/// single bit of the trajectory.
core::Result<Measurement> measure_odometry(const BenchDataset& dataset, const std::string& name,
                                           const std::vector<std::string>& overrides, int repeats);

}  // namespace nilio::tools
