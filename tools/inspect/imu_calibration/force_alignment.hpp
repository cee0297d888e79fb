#pragma once

#include "core/src/estimation/imu_buffer.hpp"
#include "core/src/imu_monitor/imu_monitor.hpp"
#include "tools/inspect/imu_calibration/axis_permutation.hpp"

#include <span>
#include <vector>

namespace nilio::tools::inspect {

/// Directions of specific force from accelerometer and registered positions.
struct ForceComparison {
  /// Gravity first, then horizontal directions in descending order of strength.
  std::vector<DirectionPair> pairs;
  /// Both horizontal directions are among them.
  bool spans_space = false;
  /// Measured over actual norm of the specific force at steady speed; 0 = unknown.
  double gravity_ratio = 0.0;
};

/// `imu` has all samples, in base_link as configured.
ForceComparison compare_forces(std::span<const core::RegisteredMotion> motions, const core::ImuBuffer& imu,
                               const core::Vector3& imu_position, core::Duration max_gap);

}  // namespace nilio::tools::inspect
