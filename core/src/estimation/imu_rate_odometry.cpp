#include "core/src/estimation/imu_rate_odometry.hpp"

namespace nilio::core {

namespace {

// A larger step back means that the clock was set.
constexpr Duration kClockWasSet = Duration::from_seconds(1.0);

}  // namespace

ImuRateOdometry::ImuRateOdometry(const ImuRateOdometryConfig& config)
    : config_(config), imu_(config.capacity) {}

void ImuRateOdometry::set_scan_pose(const ScanPose& pose) {
  scan_ = pose;
  has_pose_ = true;
  state_ = pose.state;
  state_.time = pose.state.time + pose.imu_time_shift;
  follows_gyro_ = pose.gyro_used;
  for (std::size_t i = imu_.lower_bound(state_.time); i < imu_.size(); ++i) step_to(i);
}

std::optional<PropagatedPose> ImuRateOdometry::add(const ImuSample& sample) {
  if (const auto last = imu_.latest(); last && *last - sample.stamp > kClockWasSet) imu_.clear();
  if (!imu_.add(sample, config_.T_base_imu.rotation)) return std::nullopt;
  if (!has_pose_ || sample.stamp < state_.time) return std::nullopt;
  step_to(imu_.size() - 1);
  const Duration age = latest() - scan_.state.time;
  if (age > config_.max_age) return std::nullopt;
  const MotionState& s = state_;
  return PropagatedPose{latest(), s.T_map_base, s.velocity, s.angular_velocity, age, follows_gyro_};
}

void ImuRateOdometry::step_to(std::size_t sample) {
  const Time to = imu_[sample].stamp;
  const Duration gap = to - (sample > 0 ? imu_[sample - 1].stamp : state_.time);
  MotionInputs inputs;
  inputs.imu = &imu_;
  inputs.imu_position = config_.T_base_imu.translation;
  inputs.gyro = scan_.gyro_used && gap <= config_.max_gap;
  inputs.accelerometer = scan_.accelerometer_used && inputs.gyro;
  if (!inputs.gyro) {
    state_.angular_velocity = scan_.state.angular_velocity;
    follows_gyro_ = false;
  }
  state_ = propagated(state_, inputs, to);
}

SE3 ImuRateOdometry::pose_near(Time time) const {
  return propagated(state_, {}, time + scan_.imu_time_shift).T_map_base;
}

Matrix6 propagated_covariance(const Matrix6& pose, const Matrix6& twist,
                              const Eigen::Quaterniond& R_odom_base, Duration age) {
  const Matrix6 to_odom = block_rotation(R_odom_base.toRotationMatrix());
  const double seconds = age.seconds();
  return pose + seconds * seconds * (to_odom * twist * to_odom.transpose());
}

}  // namespace nilio::core
