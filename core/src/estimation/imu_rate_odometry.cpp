#include "core/src/estimation/imu_rate_odometry.hpp"

#include <algorithm>

namespace nilio::core {

namespace {

// A larger step back means that the clock was set.
constexpr Duration kClockWasSet = Duration::from_seconds(1.0);

// Scans farther apart have lost scans between them.
constexpr Duration kLongestSpan = Duration::from_seconds(0.5);

SE3 moved(const SE3& T, const Vector3& velocity, const Vector3& rate, double seconds) {
  // Translation along the mid-step direction: second-order accurate.
  const Eigen::Quaterniond middle = T.rotation * so3_exp(rate * (0.5 * seconds));
  return {(T.rotation * so3_exp(rate * seconds)).normalized(), T.translation + middle * velocity * seconds};
}

/// Integral of the specific force in the axes of `R_odom_base` at `from`, m/s; the buffer covers the span.
Vector3 integrated_force(const ImuBuffer& imu, const Vector3& gyro_bias, Time from, Time to,
                         Eigen::Quaterniond R_odom_base) {
  Vector3 velocity = Vector3::Zero();
  Time time = from;
  for (std::size_t i = imu.lower_bound(from); time < to; ++i) {
    const Time until = i < imu.size() ? std::min(imu[i].stamp, to) : to;
    const Duration step = until - time;
    const Time middle = time + step / 2;
    const Vector3 turn = (imu.angular_velocity_at(middle) - gyro_bias) * step.seconds();
    velocity += R_odom_base * so3_exp(0.5 * turn) * imu.specific_force_at(middle) * step.seconds();
    R_odom_base = (R_odom_base * so3_exp(turn)).normalized();
    time = until;
  }
  return velocity;
}

}  // namespace

ImuRateOdometry::ImuRateOdometry(const ImuRateOdometryConfig& config)
    : config_(config), imu_(config.capacity) {}

void ImuRateOdometry::set_scan_pose(const ScanPose& pose) {
  if (has_pose_) update_accelerometer(pose);
  scan_ = pose;
  has_pose_ = true;
  imu_time_ = pose.stamp + pose.imu_time_shift;
  T_odom_base_ = pose.T_odom_base;
  velocity_ = pose.linear_velocity;
  angular_velocity_ = pose.angular_velocity;
  follows_gyro_ = pose.imu_trusted;
  for (std::size_t i = imu_.lower_bound(imu_time_); i < imu_.size(); ++i) step_to(i);
}

/// Updates the accelerometer test with the span between the last scan and this one.
void ImuRateOdometry::update_accelerometer(const ScanPose& next) {
  const Time from = scan_.stamp + next.imu_time_shift;
  const Time to = next.stamp + next.imu_time_shift;
  if (!scan_.imu_trusted || !next.imu_trusted || scan_.predicted || next.predicted) return;
  if (to <= from || to - from > kLongestSpan || !imu_.covers(from, to, config_.max_gap)) return;
  AccelerometerConsistency::Evidence evidence;
  evidence.seconds = (to - from).seconds();
  evidence.imu_change = integrated_force(imu_, next.gyro_bias, from, to, scan_.T_odom_base.rotation);
  const auto velocity = [&](const ScanPose& scan, Time imu_time) -> Vector3 {
    return scan.T_odom_base.rotation *
           (scan.linear_velocity + lever(imu_.angular_velocity_at(imu_time) - next.gyro_bias));
  };
  evidence.measured = velocity(next, to) - velocity(scan_, from);
  evidence.held_error = (next.linear_velocity - scan_.linear_velocity).norm();
  accelerometer_.update(evidence);
}

Vector3 ImuRateOdometry::rate_at(Time imu_time) const {
  return imu_.angular_velocity_at(imu_time) - scan_.gyro_bias;
}

Vector3 ImuRateOdometry::lever(const Vector3& rate) const {
  return rate.cross(config_.T_base_imu.translation);
}

std::optional<PropagatedPose> ImuRateOdometry::add(const ImuSample& sample) {
  if (const auto last = imu_.latest(); last && *last - sample.stamp > kClockWasSet) imu_.clear();
  if (!imu_.add(sample, config_.T_base_imu.rotation)) return std::nullopt;
  if (!has_pose_ || sample.stamp < imu_time_) return std::nullopt;
  step_to(imu_.size() - 1);
  const Duration age = latest() - scan_.stamp;
  if (age > config_.max_age) return std::nullopt;
  return PropagatedPose{latest(), T_odom_base_, velocity_, angular_velocity_, age, follows_gyro_};
}

void ImuRateOdometry::step_to(std::size_t sample) {
  const BaseImuSample& to = imu_[sample];
  const Duration step = to.stamp - imu_time_;
  const Duration gap = sample > 0 ? to.stamp - imu_[sample - 1].stamp : step;
  if (scan_.imu_trusted && gap <= config_.max_gap) {
    follow_gyro(to.stamp);
  } else {
    angular_velocity_ = scan_.angular_velocity;
    follows_gyro_ = false;
    T_odom_base_ = moved(T_odom_base_, velocity_, angular_velocity_, step.seconds());
  }
  imu_time_ = to.stamp;
}

void ImuRateOdometry::follow_gyro(Time to) {
  const Duration step = to - imu_time_;
  const Time middle = imu_time_ + step / 2;
  const Vector3 rate = rate_at(middle);
  angular_velocity_ = rate_at(to);
  if (!accelerometer_.helps()) {
    T_odom_base_ = moved(T_odom_base_, velocity_, rate, step.seconds());
    return;
  }
  const SE3 before = T_odom_base_;
  T_odom_base_ = moved(before, velocity_, rate, step.seconds());
  // dv_imu = (R f - g) dt at the IMU; base_link's velocity follows by the lever arm.
  const Eigen::Quaterniond half = before.rotation * so3_exp(rate * (0.5 * step.seconds()));
  const Vector3 change =
      (half * imu_.specific_force_at(middle) - accelerometer_.gravity_bias()) * step.seconds();
  const Vector3 moving = before.rotation * (velocity_ + lever(rate_at(imu_time_))) + change;
  const Vector3 held = T_odom_base_.rotation * velocity_;
  velocity_ = T_odom_base_.rotation.conjugate() * moving - lever(angular_velocity_);
  T_odom_base_.translation += 0.5 * step.seconds() * (T_odom_base_.rotation * velocity_ - held);
}

SE3 ImuRateOdometry::pose_near(Time time) const {
  return moved(T_odom_base_, velocity_, angular_velocity_, (time - latest()).seconds());
}

Matrix6 propagated_covariance(const Matrix6& pose, const Matrix6& twist,
                              const Eigen::Quaterniond& R_odom_base, Duration age) {
  const Matrix6 to_odom = block_rotation(R_odom_base.toRotationMatrix());
  const double seconds = age.seconds();
  return pose + seconds * seconds * (to_odom * twist * to_odom.transpose());
}

}  // namespace nilio::core
