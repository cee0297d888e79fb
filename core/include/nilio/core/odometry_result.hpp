#pragma once

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"
#include "nilio/core/tracking.hpp"

#include <array>
#include <cstddef>
#include <cstdint>

namespace nilio::core {

/// Moments inside register_scan, by the injected clock.
enum class OdometryStage : std::uint8_t { kStarted, kFiltered, kCoarse, kFine, kMapped, kCount };

struct OdometryResult {
  std::uint64_t sequence = 0;
  Time scan_start;
  Time scan_end;
  /// Pose of base_link at scan_end.
  SE3 T_odom_base;
  /// Pose of base_link half-way between scan_start and scan_end, which the points of a sweep determine best.
  /// Equal to T_odom_base for scans without a known motion: the first one and motion-compensated ones.
  SE3 T_odom_base_middle;
  /// Covariance of the registration against the map: position then rotation, in odom axes; m^2, rad^2.
  Matrix6 pose_covariance = Matrix6::Zero();
  /// Covariance of the pose since the start: the drift of the map beside that of the registration; the same
  /// axes and units.
  Matrix6 drift_covariance = Matrix6::Zero();
  /// Linear then angular velocity of base_link in its own axes, m/s and rad/s.
  Vector6 twist = Vector6::Zero();
  /// Mean angular rate used for deskewing, rad/s in base_link; 0 without deskewing.
  Vector3 deskew_rate = Vector3::Zero();
  Matrix6 twist_covariance = Matrix6::Zero();
  /// Bias subtracted from the gyro's rates, rad/s in base_link, and shift subtracted from the IMU's stamps.
  Vector3 gyro_bias = Vector3::Zero();
  Duration imu_time_shift;
  /// Bias subtracted from the specific forces, m/s^2 in base_link, and gravity in odom.
  Vector3 accelerometer_bias = Vector3::Zero();
  Vector3 gravity = Vector3::Zero();
  TrackingState state = TrackingState::kInitialising;
  StopReason stop_reason = StopReason::kConverged;
  bool imu_used = false;
  /// The accelerometer predicted the velocity, beside the gyro.
  bool accelerometer_used = false;
  /// No registration was accepted, or no point met the map: the pose is the prediction.
  bool predicted = false;
  std::uint8_t degenerate_axes = 0;
  /// Time for the recovery that this scan was allowed beyond the configured budget; 0 = it only tracked.
  Duration recovery_budget;
  /// How far the budget cut the registration, independent of convergence.
  DegradationLevel degradation_level = DegradationLevel::kFull;
  int passes = 0;
  int coarse_iterations = 0;
  int fine_iterations = 0;
  std::uint32_t points = 0;
  std::uint32_t points_filtered = 0;
  std::uint32_t points_used = 0;
  std::uint32_t correspondences = 0;
  /// Share of the points used that lie within the inlier distance of a map plane.
  double inlier_ratio = 0.0;
  std::uint32_t map_voxels = 0;
  std::uint64_t map_refused = 0;
  std::array<std::int64_t, static_cast<std::size_t>(OdometryStage::kCount)> stage_ns{};

  /// Time at which the stage ended.
  [[nodiscard]] std::int64_t stage_time_ns(OdometryStage stage) const {
    return stage_ns[static_cast<std::size_t>(stage)];
  }
};

}  // namespace nilio::core
