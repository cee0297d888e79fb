#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/odometry/consistency.hpp"
#include "tools/bench/odometry/run.hpp"
#include "tools/common/statistics.hpp"
#include "tools/evaluate/metrics.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// Errors of a trajectory.
struct Accuracy {
  /// Means over the segments of 10 to 80 m and of 100 to 800 m; empty where the path is shorter.
  std::optional<evaluate::SegmentError> near;
  std::optional<evaluate::SegmentError> far;
  double ape_m = 0.0;  ///< rmse after SE(3) alignment
  double rpe_m = 0.0;  ///< rmse from scan to scan
  double rpe_deg = 0.0;
  double end_drift_percent = 0.0;
  double truth_length_m = 0.0;
  double estimate_length_m = 0.0;
};

/// Fails when the trajectories do not overlap in time.
core::Result<Accuracy> measure_accuracy(const Trajectory& truth, const Trajectory& estimate);

/// Stages of a scan: filter (with prediction, deskewing and point selection), coarse and fine registration,
/// map update.
inline constexpr std::size_t kStages = 4;
inline constexpr std::size_t kCoarseStage = 1;
inline constexpr std::size_t kFineStage = 2;
const char* stage_name(std::size_t stage);

/// Times per scan, milliseconds.
struct StageTimes {
  Percentiles total;
  /// Time since the end of the previous scan: includes decoding the packets (or reading a KITTI file) and the
  /// handling of the pose. Only meaningful for a CPU clock, which stops while the thread waits.
  Percentiles with_feed;
  std::array<Percentiles, kStages> stages;
  std::vector<double> per_scan;  ///< totals, in order
};

/// Work of the odometry, means per scan.
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
  /// Calls of operator new inside register_scan(): during the first kWarmUpScans, and per scan afterwards.
  std::int64_t allocations_warming_up = 0;
  double allocations_per_scan = 0.0;
  std::uint64_t peak_resident_bytes = 0;
  std::uint64_t resident_before_bytes = 0;
  std::string sha256;
  Trajectory trajectory;
};

inline constexpr std::size_t kWarmUpScans = 10;

/// Runs the data set under `overrides`, `repeats` times each for wall and CPU time, and once for allocations.
/// The minimum time of each scan counts. Fails when the trajectories of two runs differ in a single bit.
core::Result<Measurement> measure_odometry(const BenchDataset& dataset, const std::string& name,
                                           const std::vector<std::string>& overrides, int repeats);

/// Name of a run in tables: "ndt_icp, 2 threads".
std::string label_of(const Measurement& measurement);

/// Runs the Point Cloud Library's NDT and ICP, scan to scan and scan to a map of ten scans, on the scans that
/// the odometry registers under `overrides`, deskewed and downsampled by it, in the same process and thread.
/// Fails when nilio was built without PCL.
core::Result<std::vector<Measurement>> measure_pcl(const BenchDataset& dataset,
                                                   const std::vector<std::string>& overrides);

}  // namespace nilio::tools::bench
