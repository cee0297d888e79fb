#pragma once

#include "nilio/core/odometry.hpp"

#include "tools/common/trajectory.hpp"

#include <cstddef>
#include <span>

namespace nilio::tools::bench {

/// Normalised estimation error squared (Bar-Shalom, Li, Kirubarajan 2001, section 5.4), divided by the six
/// degrees of freedom: 1 for a correct covariance, less for one that is too large, more for one that is too
/// small.
struct Nees {
  std::size_t count = 0;
  double mean = 0.0;
  /// Share of the errors inside the 95 % region of the covariance.
  double within_95 = 0.0;
};

struct Consistency {
  /// NEES of the motion between consecutive scans; the covariances of the two poses are taken as independent.
  Nees step;
  /// NEES of the motion over ten scans.
  Nees second;
  /// NEES of the twist against the true mean twist of the sweep.
  Nees twist;
};

/// Whether the pose comes from its scan, and not from a prediction.
bool is_registered(const core::OdometryResult& result);

/// Normalised estimation error squared of the motion from `from` to `to`, for each degree of freedom; the
/// covariances of the two poses are taken as independent.
double motion_nees(const core::OdometryResult& from, const core::SE3& true_from,
                   const core::OdometryResult& to, const core::SE3& true_to);
/// The same of a pose since the start, with its drift covariance.
double drift_nees(const core::OdometryResult& first, const core::SE3& true_first,
                  const core::OdometryResult& last, const core::SE3& true_last);

/// Evaluates all registered scans after the initialisation. Counts are 0 where the truth has no poses within
/// a sweep (KITTI).
Consistency evaluate_consistency(const Trajectory& truth, std::span<const core::OdometryResult> results);

}  // namespace nilio::tools::bench
