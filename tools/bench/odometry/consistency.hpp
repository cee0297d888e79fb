#pragma once

#include "nilio/core/odometry.hpp"

#include "tools/evaluate/trajectory.hpp"

#include <cstddef>
#include <span>

namespace nilio::tools {

/// Normalised estimation error squared (Bar-Shalom, Li, Kirubarajan 2001, section 5.4) for each of the six
/// degrees of freedom: 1 where errors are as large as their covariance says, less where it is cautious, more
/// where it says too little.
struct Nees {
  std::size_t count = 0;
  double mean = 0.0;
  /// Share of the errors within the region that holds 95 % of those of a covariance that is exact.
  double within_95 = 0.0;
};

struct Consistency {
  /// Of what the vehicle moved by between two poses, whose covariances are taken to be independent.
  Nees step;
  /// The same over a second.
  Nees second;
  /// Of the twist, against the mean one of the sweep.
  Nees twist;
};

/// Of all scans that were registered, those of the initialisation left out. Empty counts where the truth does
/// not tell poses within a sweep.
Consistency judge_consistency(const Trajectory& truth, std::span<const core::OdometryResult> results);

}  // namespace nilio::tools
