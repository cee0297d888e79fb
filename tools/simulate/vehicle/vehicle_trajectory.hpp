#pragma once

#include "nilio/core/se3.hpp"

#include "tools/simulate/vehicle/body_motion.hpp"

#include <memory>
#include <vector>

namespace nilio::tools::simulate {

/// Motion of the vehicle at one instant.
struct MotionState {
  core::SE3 T_world_base;
  core::Vector3 velocity = core::Vector3::Zero();              ///< of base in world, m/s
  core::Vector3 acceleration = core::Vector3::Zero();          ///< of base in world, m/s^2, without gravity
  core::Vector3 angular_velocity = core::Vector3::Zero();      ///< in base axes, rad/s
  core::Vector3 angular_acceleration = core::Vector3::Zero();  ///< in base axes, rad/s^2
};

/// Vehicle motion in continuous time: uniform cubic B-splines, of the position in R^3 and cumulative on SO(3)
/// of the orientation, both twice continuously differentiable with exact derivatives (Sommer et al.,
/// "Efficient derivative computation for cumulative B-splines on Lie groups", CVPR 2020). World is z up,
/// metres. Immutable, so any number of threads may read it.
class VehicleTrajectory {
 public:
  /// `control_poses` (T_world_base, at least two) are for the times 0, interval_s, 2 * interval_s...; the
  /// curve approximates them smoothly.
  VehicleTrajectory(const std::vector<core::SE3>& control_poses, double interval_s);

  [[nodiscard]] double duration_s() const { return duration_s_; }
  /// Times outside [0, duration_s()] are clamped.
  [[nodiscard]] core::SE3 pose(double time_s) const { return state(time_s).T_world_base; }
  [[nodiscard]] MotionState state(double time_s) const;

  /// The same drive with the body moving on its wheels; the body's motion starts at time 0.
  [[nodiscard]] VehicleTrajectory with_body(std::shared_ptr<const BodyMotion> body) const;
  /// Speed along the vehicle's x axis and distance, for BodyMotion.
  [[nodiscard]] RoadTravel travel() const;

 private:
  [[nodiscard]] MotionState smooth_state(double time_s) const;
  double interval_s_;
  double duration_s_;
  std::vector<core::SE3> controls_;
  /// Rotation vectors from each control pose to the next.
  std::vector<core::Vector3> steps_;
  /// Null = smooth.
  std::shared_ptr<const BodyMotion> body_;
};

/// Limits of a drive.
struct DriveExtent {
  double length_m = 0.0;    ///< 0 = no limit
  double duration_s = 0.0;  ///< 0 = no limit
};

/// The control poses (one every `interval_s`) up to the end of the extent; at least two.
std::vector<core::SE3> cut_drive(std::vector<core::SE3> poses, double interval_s, const DriveExtent& extent);

/// Length of the path through the poses' origins, metres.
double path_length(const std::vector<core::SE3>& poses);

/// Spacing of the control poses.
inline constexpr double kControlIntervalS = 0.05;
/// Stationary time at the start, in which an estimator initialises gravity and gyro bias.
inline constexpr double kStationaryTimeS = 2.0;

}  // namespace nilio::tools::simulate
