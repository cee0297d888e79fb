#include "daemon/odometry/cloud_feed.hpp"

#include <algorithm>
#include <numbers>

namespace nilio::daemon {

namespace {

// Distance and angle between two poses of the path.
constexpr double kPathStepMetres = 1.0;
constexpr double kPathStepRadians = 0.1;
// Between two keyframes.
constexpr double kKeyframeStepMetres = 1.0;
constexpr double kKeyframeStepRadians = 5.0 * std::numbers::pi / 180.0;

/// Whether a pose is one step or more away from the last one.
bool is_step(const std::optional<core::SE3>& T_odom_last, const core::SE3& T_odom_base, double metres,
             double radians) {
  if (!T_odom_last) return true;
  const core::SE3 step = T_odom_last->inverse() * T_odom_base;
  return step.translation.norm() >= metres || core::so3_log(step.rotation).norm() >= radians;
}

template <class Record>
void set_pose(const core::SE3& T_odom_base, Record& record) {
  record.orientation_xyzw = core::xyzw(T_odom_base.rotation);
  for (Eigen::Index i = 0; i < 3; ++i)
    record.position[static_cast<std::size_t>(i)] = T_odom_base.translation[i];
}

}  // namespace

void CloudFeed::fill_cloud(const core::OdometryResult& result, const core::Odometry& odometry) {
  const std::vector<Eigen::Vector3f>& points = odometry.deskewed_points();
  ipc::ScanCloud& cloud = *cloud_;
  cloud.sequence = result.sequence;
  cloud.stamp_ns = result.scan_end.ns;
  set_pose(result.T_odom_base, cloud);
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column)
      cloud.covariance[static_cast<std::size_t>(6 * row + column)] = result.pose_covariance(row, column);
  }
  // The points are ordered such that any first part of them is spread evenly over the scan.
  cloud.count = std::min(points.size(), cloud.points.size());
  for (std::size_t i = 0; i < cloud.count; ++i)
    cloud.points[i] = {points[i].x(), points[i].y(), points[i].z(), odometry.deskewed_intensity(i)};
}

void CloudFeed::add_to_path(const core::OdometryResult& result) {
  if (!is_step(T_odom_path_, result.T_odom_base, kPathStepMetres, kPathStepRadians)) return;
  T_odom_path_ = result.T_odom_base;
  ipc::PathPose pose;
  pose.stamp_ns = result.scan_end.ns;
  set_pose(result.T_odom_base, pose);
  publisher_->publish_path_pose(pose);
}

bool CloudFeed::is_keyframe(const core::OdometryResult& result) const {
  // A predicted or lost pose says nothing of where the points are.
  return mapper_ != nullptr && !result.predicted && result.state != core::TrackingState::kLost &&
         is_step(T_odom_keyframe_, result.T_odom_base, kKeyframeStepMetres, kKeyframeStepRadians);
}

void CloudFeed::add(const core::OdometryResult& result, const core::Odometry& odometry) {
  if (publisher_ != nullptr) add_to_path(result);
  // A predicted pose has no registered scan.
  const bool is_wanted = publisher_ != nullptr && !result.predicted && publisher_->wants_scans();
  const bool keyframe = is_keyframe(result);
  if (!is_wanted && !keyframe) return;
  fill_cloud(result, odometry);
  if (is_wanted) publisher_->publish_scan(*cloud_);
  if (!keyframe) return;
  mapper_->push(*cloud_);
  T_odom_keyframe_ = result.T_odom_base;
}

}  // namespace nilio::daemon
