#include "core/src/odometry_impl.hpp"

#include <algorithm>

namespace nilio::core {

namespace {

// What is not known better than by scans alone, and of what stands.
constexpr double kLeastVelocityVariance = 0.1 * 0.1;
constexpr double kLeastSupportVariance = 0.01 * 0.01;
constexpr double kStandingSpeedVariance = 0.02 * 0.02;

}  // namespace

void Odometry::State::set_rotation(const SweepMotion::Span& target_span, bool with_imu,
                                   const Vector6& expected, SweepMotion& target) const {
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

/// What the accelerometer says of the time from the middle of the last sweep to that of the next one.
std::optional<Vector3> Odometry::State::felt_acceleration(const Outlook& next) const {
  const SweepMotion::Span& span = next.span;
  const Time from = span.previous - Duration::from_seconds(0.5 * last_sweep_s);
  if (!monitor.force_usable(from)) return std::nullopt;
  return felt_velocity.acceleration(turn_rate(next.imu_used), from, span.end - (span.end - span.start) / 2,
                                    T_map_base.rotation * last_half_sweep.rotation.conjugate(),
                                    twist.twist().head<3>());
}

/// What stands is held still and shows what its accelerometer feels while it does.
bool Odometry::State::stands_since_start() {
  if (is_felt()) {
    const Time end = ahead.span.end;
    return standing_start.observe(imu_statistics(imu, end - StandingStart::kWindow, end),
                                  T_map_base.translation);
  }
  if (scans >= kInitialScans) standing_start.end();
  return false;
}

/// How exact the prediction is where the accelerometer carries it on.
void Odometry::State::advance_felt_motion() {
  if (ahead.stands) {
    felt_motion.begin({kStandingSpeedVariance, kStandingSupportVariance});
    return;
  }
  const AccelerometerJudge& judge = felt_velocity.judge();
  const double seconds = motion.between_s(last_sweep_s);
  if (!ahead.acceleration || !felt_motion.has_begun()) {
    const double by_error = prediction_square.head<3>().maxCoeff() / (seconds * seconds);
    felt_motion.begin({std::max({kLeastVelocityVariance, judge.velocity_variance(), by_error}),
                       std::max(kLeastSupportVariance, judge.support_variance())});
  }
  felt_motion.advance(seconds, seconds * motion.mean_angular_velocity().z());
}

/// Between the middles of the last sweep and of this one.
TwistStep Odometry::State::measured_step() const {
  const double seconds = motion.between_s(last_sweep_s);
  const Matrix3 R = T_predicted.rotation.toRotationMatrix();
  return {seconds, ahead.acceleration, seconds * felt_motion.velocity_gain(R)};
}

/// Over the middle of the span, which the prediction is for.
Vector6 Odometry::State::expected_twist(const Outlook& next) const {
  return twist.predict({next.span_s(), next.acceleration});
}

SE3 Odometry::State::expected_pose(const Outlook& next, SweepMotion& target) const {
  const Vector6 expected = expected_twist(next);
  set_rotation(next.span, next.imu_used, expected, target);
  return T_map_base * target.predict(expected.head<3>());
}

void Odometry::State::predict(const Scan& scan, OdometryResult& result) {
  ahead = outlook(scan);
  relocated = failures > 0;
  ahead.stands = stands_since_start();
  if (is_held_still()) ahead.acceleration = Vector3::Zero();
  T_predicted = expected_pose(ahead, motion);
  advance_felt_motion();
  result.imu_used = ahead.imu_used;
}

}  // namespace nilio::core
