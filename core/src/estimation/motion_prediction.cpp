#include "core/src/odometry_impl.hpp"

#include <algorithm>

namespace nilio::core {

namespace {

// Lower bounds of the variances, and those of a stationary vehicle.
constexpr double kMinVelocityVariance = 0.1 * 0.1;
constexpr double kMinGravityBiasVariance = 0.01 * 0.01;
constexpr double kStandingSpeedVariance = 0.02 * 0.02;

}  // namespace

void Odometry::State::set_rotation(const MotionModel::Span& target_span, bool with_imu,
                                   const Vector6& expected, MotionModel& target) const {
  if (with_imu) {
    target.set_rotation_from_imu(target_span, imu, gyro_bias);
  } else {
    target.set_constant_rotation(target_span, expected.tail<3>());
  }
}

TurnRate Odometry::State::turn_rate(bool by_gyro) const {
  TurnRate rate{imu, gyro_bias, {}};
  if (!by_gyro) rate.held = twist.twist().tail<3>();
  return rate;
}

/// Mean acceleration between the midpoints of the last sweep and the next one.
std::optional<Vector3> Odometry::State::imu_acceleration(const MotionPrior& next) const {
  const MotionModel::Span& span = next.span;
  const Time from = span.previous - Duration::from_seconds(0.5 * last_sweep_s);
  if (!monitor.force_usable(from)) return std::nullopt;
  return inertial_velocity.acceleration(
      turn_rate(next.imu_used), from, span.end - (span.end - span.start) / 2,
      T_map_base.rotation * last_T_middle_end.rotation.conjugate(), twist.twist().head<3>());
}

/// Zero-velocity update while stationary since the start; the mean specific force initialises gravity.
bool Odometry::State::detect_static_start() {
  if (accelerometer_observes_motion()) {
    const Time end = motion_prior.span.end;
    return static_initialization.observe(imu_statistics(imu, end - StaticInitialization::kWindow, end),
                                         T_map_base.translation);
  }
  if (scans >= kInitialScans) static_initialization.end();
  return false;
}

/// Propagates the covariance of the IMU-predicted motion.
void Odometry::State::propagate_motion_filter() {
  if (motion_prior.is_stationary) {
    motion_filter.begin({kStandingSpeedVariance, kStationaryGravityBiasVariance});
    return;
  }
  const AccelerometerConsistency& consistency = inertial_velocity.consistency();
  const double seconds = motion.between_s(last_sweep_s);
  if (!motion_prior.acceleration || !motion_filter.has_begun()) {
    const double by_error = prediction_error_variance.head<3>().maxCoeff() / (seconds * seconds);
    motion_filter.begin({std::max({kMinVelocityVariance, consistency.velocity_variance(), by_error}),
                         std::max(kMinGravityBiasVariance, consistency.gravity_bias_variance())});
  }
  motion_filter.advance(seconds, seconds * motion.mean_angular_velocity().z());
}

/// Step between the midpoints of the last sweep and this one.
TwistStep Odometry::State::measured_step() const {
  const double seconds = motion.between_s(last_sweep_s);
  const Matrix3 R = T_predicted.rotation.toRotationMatrix();
  return {seconds, motion_prior.acceleration, seconds * motion_filter.velocity_gain(R)};
}

/// Twist at the middle of the predicted span.
Vector6 Odometry::State::expected_twist(const MotionPrior& next) const {
  return twist.predict({next.span_s(), next.acceleration});
}

SE3 Odometry::State::expected_pose(const MotionPrior& next, MotionModel& target) const {
  const Vector6 expected = expected_twist(next);
  set_rotation(next.span, next.imu_used, expected, target);
  return T_map_base * target.predict(expected.head<3>());
}

void Odometry::State::predict(const Scan& scan, OdometryResult& result) {
  motion_prior = motion_prior_for(scan);
  relocalized = failures > 0;
  motion_prior.is_stationary = detect_static_start();
  if (applies_zero_velocity_update()) motion_prior.acceleration = Vector3::Zero();
  T_predicted = expected_pose(motion_prior, motion);
  propagate_motion_filter();
  result.imu_used = motion_prior.imu_used;
}

}  // namespace nilio::core
