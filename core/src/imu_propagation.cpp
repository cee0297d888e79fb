#include "nilio/core/imu_propagation.hpp"

namespace nilio::core {

namespace {

// Stamps that go back farther are of a clock that was set, or come after one that was wrong.
constexpr Duration kClockWasSet = Duration::from_seconds(1.0);

SE3 moved(const SE3& T, const Vector3& velocity, const Vector3& rate, double seconds) {
  // Straight on along the direction in the middle of the step: right to second order.
  const Eigen::Quaterniond middle = T.rotation * so3_exp(rate * (0.5 * seconds));
  return {(T.rotation * so3_exp(rate * seconds)).normalized(), T.translation + middle * velocity * seconds};
}

}  // namespace

ImuPropagator::ImuPropagator(const ImuPropagatorConfig& config) : config_(config), imu_(config.capacity) {}

void ImuPropagator::set_scan_pose(const ScanPose& pose) {
  scan_ = pose;
  has_pose_ = true;
  imu_time_ = pose.stamp + pose.imu_time_shift;
  T_odom_base_ = pose.T_odom_base;
  angular_velocity_ = pose.angular_velocity;
  follows_gyro_ = pose.imu_trusted;
  for (std::size_t i = imu_.lower_bound(imu_time_); i < imu_.size(); ++i) step_to(i);
}

std::optional<PropagatedPose> ImuPropagator::add(const ImuSample& sample) {
  if (const auto last = imu_.latest(); last && *last - sample.stamp > kClockWasSet) imu_.clear();
  if (!imu_.add(sample, config_.T_base_imu.rotation)) return std::nullopt;
  if (!has_pose_ || sample.stamp < imu_time_) return std::nullopt;
  step_to(imu_.size() - 1);
  const Duration age = latest() - scan_.stamp;
  if (age > config_.max_age) return std::nullopt;
  return PropagatedPose{latest(), T_odom_base_, scan_.linear_velocity, angular_velocity_, age, follows_gyro_};
}

void ImuPropagator::step_to(std::size_t sample) {
  const BaseImuSample& to = imu_[sample];
  const Duration step = to.stamp - imu_time_;
  const Duration gap = sample > 0 ? to.stamp - imu_[sample - 1].stamp : step;
  Vector3 rate = scan_.angular_velocity;
  if (scan_.imu_trusted && gap <= config_.max_gap) {
    rate = imu_.angular_velocity_at(imu_time_ + step / 2) - scan_.gyro_bias;
    angular_velocity_ = to.angular_velocity - scan_.gyro_bias;
  } else {
    angular_velocity_ = rate;
    follows_gyro_ = false;
  }
  T_odom_base_ = moved(T_odom_base_, scan_.linear_velocity, rate, step.seconds());
  imu_time_ = to.stamp;
}

SE3 ImuPropagator::pose_near(Time time) const {
  return moved(T_odom_base_, scan_.linear_velocity, angular_velocity_, (time - latest()).seconds());
}

Matrix6 propagated_covariance(const Matrix6& pose, const Matrix6& twist,
                              const Eigen::Quaterniond& R_odom_base, Duration age) {
  Matrix6 to_odom = Matrix6::Zero();
  to_odom.topLeftCorner<3, 3>() = R_odom_base.toRotationMatrix();
  to_odom.bottomRightCorner<3, 3>() = to_odom.topLeftCorner<3, 3>();
  const double seconds = age.seconds();
  return pose + seconds * seconds * (to_odom * twist * to_odom.transpose());
}

}  // namespace nilio::core
