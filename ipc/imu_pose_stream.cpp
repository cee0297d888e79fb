#include "ipc/imu_pose_stream.hpp"

#include <algorithm>

namespace nilio::ipc {

namespace {

using core::Duration;
using core::Time;

// Stamps that go back farther come from a clock that was set; they are followed.
constexpr Duration kClockWasSet = Duration::from_seconds(1.0);

using RowMajor6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;

core::Vector3 vector(const std::array<double, 3>& values) { return core::Vector3(values.data()); }

core::ScanPose scan_pose(const PoseRecord& record) {
  core::ScanPose pose;
  pose.state.time = {record.stamp_ns};
  pose.state.T_map_base = {core::from_xyzw(record.orientation_xyzw), vector(record.position)};
  pose.state.velocity = vector(record.linear_velocity);
  pose.state.angular_velocity = vector(record.angular_velocity);
  pose.state.gyro_bias = vector(record.gyro_bias);
  pose.state.accelerometer_bias = vector(record.accelerometer_bias);
  pose.state.gravity = vector(record.gravity);
  pose.imu_time_shift = {record.imu_time_shift_ns};
  pose.gyro_used = record.imu_used;
  pose.accelerometer_used = record.accelerometer_used;
  return pose;
}

}  // namespace

ImuPoseStream::ImuPoseStream(const ImuPoseConfig& config)
    : propagator_(config.propagation),
      smoother_(config.slew),
      period_(config.max_rate_hz > 0.0 ? Duration::from_seconds(1.0 / config.max_rate_hz) : Duration{0}) {}

ImuPoseUpdate ImuPoseStream::add(const PoseRecord& record) {
  ++counts_.scan_poses;
  const core::ScanPose pose = scan_pose(record);
  const Time stamp = pose.state.time;
  ImuPoseUpdate update{record.sequence, stamp, stamp, {}};
  if (last_smoothed_) {
    // Both poses are compared at the later of the two times, so that time does not go back.
    update.stamp = std::max(propagator_.latest(), stamp);
    const core::SE3 before = propagator_.pose_near(update.stamp);
    propagator_.set_scan_pose(pose);
    update.correction = smoother_.correct(before, propagator_.pose_near(update.stamp));
  } else {
    propagator_.set_scan_pose(pose);
  }
  pose_covariance_ = Eigen::Map<const RowMajor6>(record.pose_covariance.data());
  twist_covariance_ = Eigen::Map<const RowMajor6>(record.twist_covariance.data());
  return update;
}

std::optional<ImuPose> ImuPoseStream::add(const ImuRecord& record) {
  ++counts_.samples;
  const std::optional<core::PropagatedPose> pose = propagator_.add(record.sample);
  const Duration since = pose && last_smoothed_ ? pose->stamp - *last_smoothed_ : Duration{0};
  // A new time shift of the IMU may put samples before the last published pose.
  if (!pose || (since.ns < 0 && since > -kClockWasSet)) {
    ++counts_.withheld;
    return std::nullopt;
  }
  last_smoothed_ = pose->stamp;
  ImuPose output;
  output.T_odom_base = smoother_.smooth(pose->T_odom_base, since);
  if (!is_due(pose->stamp)) {
    ++counts_.thinned;
    return std::nullopt;
  }
  ++counts_.published;
  output.stamp = pose->stamp;
  output.linear_velocity = pose->linear_velocity;
  output.angular_velocity = pose->angular_velocity;
  output.received_ns = record.received_ns;
  fill_covariances(*pose, output);
  return output;
}

ImuPoseCounts ImuPoseStream::counts() const {
  ImuPoseCounts counts = counts_;
  counts.jumps = smoother_.jumps();
  return counts;
}

bool ImuPoseStream::is_due(Time stamp) {
  if (period_.ns == 0) return true;
  if (next_due_ && stamp < *next_due_ && *next_due_ - stamp <= period_) return false;
  // The due times follow the first sample, which keeps the rate with irregular samples.
  next_due_ = next_due_ && stamp - *next_due_ < period_ ? *next_due_ + period_ : stamp + period_;
  return true;
}

/// The residual correction is a known error of the published pose and is added to the covariance.
void ImuPoseStream::fill_covariances(const core::PropagatedPose& pose, ImuPose& output) const {
  core::Matrix6 covariance =
      core::propagated_covariance(pose_covariance_, twist_covariance_, pose.T_odom_base.rotation, pose.age);
  core::Vector6 left;
  left << smoother_.translation_left(), smoother_.rotation_left();
  covariance += left * left.transpose();
  Eigen::Map<RowMajor6>(output.pose_covariance.data()) = covariance;
  Eigen::Map<RowMajor6>(output.twist_covariance.data()) = twist_covariance_;
}

}  // namespace nilio::ipc
