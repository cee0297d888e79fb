#pragma once

#include "nilio/core/odometry_result.hpp"
#include "nilio/core/result.hpp"

#include "tools/common/trajectory.hpp"

#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// A pose of base_link as it was published, and the true one.
struct CheckedPose {
  core::Time stamp;
  core::SE3 estimate;
  std::optional<core::SE3> truth;  ///< unset outside the truth's time
  bool is_tracking = true;
};

/// Figures of one run.
struct RunFigures {
  std::string failure;  ///< why it could not be run; empty = it ran
  double path_m = 0.0;
  /// Mean translation error over segments of 10 to 80 m (KITTI metric), per cent of their length; without
  /// segments the error at the end, of the path or at least 10 m.
  double drift_percent = 0.0;
  double end_error_m = 0.0;
  double rpe_m = 0.0;  ///< rmse from pose to pose
  /// Normalised estimation error squared of the motion over one second, one value every five seconds, for
  /// each degree of freedom: 1 for a correct covariance.
  double nees = 0.0;
  std::size_t nees_count = 0;
  /// Of the last pose since the start, with its drift covariance, per degree of freedom; not a number without
  /// such a pose.
  double drift_nees = std::numeric_limits<double>::quiet_NaN();
  /// Time during which the motion over the last second was wrong although both its poses said tracking.
  double silent_error_s = 0.0;
  /// Longest time from the loss of tracking until it was tracking again, or until the end.
  double recovery_s = 0.0;
  double cpu_ms = 0.0;  ///< mean per scan
  std::size_t poses = 0;
  std::size_t tracking = 0;
  std::size_t degraded = 0;
  std::size_t lost = 0;
  bool ends_tracking = false;
};

/// Ran to its end, no silent error, and a drift within the bound.
bool is_success(const RunFigures& figures, double bound_percent);
/// "", "not run", "silent error", "lost" or "drift".
std::string describe_failure(const RunFigures& figures, double bound_percent);

/// Pairs results with the true poses at the ends of their scans (TUM).
std::vector<CheckedPose> check_poses(std::span<const core::OdometryResult> results, const Trajectory& truth);
/// The same for a trajectory without states, which counts as tracking all the time.
std::vector<CheckedPose> check_poses(const Trajectory& estimate, const Trajectory& truth);

/// Figures that poses alone give.
RunFigures measure_poses(std::span<const CheckedPose> poses);
/// All figures of a run. The stamps of the stages are CPU times.
RunFigures measure_run(std::span<const core::OdometryResult> results, const Trajectory& truth);

/// Time during which the motion over the last second was off by more than 0.10 m + 2 % or 1 degree.
double silent_error_seconds(std::span<const CheckedPose> poses);
double longest_recovery_seconds(std::span<const CheckedPose> poses);

}  // namespace nilio::tools::bench
