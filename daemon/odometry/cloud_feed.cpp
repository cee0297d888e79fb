#include "daemon/odometry/cloud_feed.hpp"

#include <algorithm>

namespace nilio::daemon {

namespace {

// Distance and angle between two poses of the path.
constexpr double kPathStepMetres = 1.0;
constexpr double kPathStepRadians = 0.1;

template <class Record>
void set_pose(const core::SE3& T_odom_base, Record& record) {
  const Eigen::Quaterniond& q = T_odom_base.rotation;
  record.orientation_xyzw = {q.x(), q.y(), q.z(), q.w()};
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
  if (T_odom_path_) {
    const core::SE3 step = T_odom_path_->inverse() * result.T_odom_base;
    if (step.translation.norm() < kPathStepMetres && core::so3_log(step.rotation).norm() < kPathStepRadians)
      return;
  }
  T_odom_path_ = result.T_odom_base;
  ipc::PathPose pose;
  pose.stamp_ns = result.scan_end.ns;
  set_pose(result.T_odom_base, pose);
  publisher_->publish_path_pose(pose);
}

void CloudFeed::add(const core::OdometryResult& result, const core::Odometry& odometry) {
  if (publisher_ == nullptr) return;
  add_to_path(result);
  // A predicted pose has no registered scan.
  if (result.predicted || !publisher_->wants_scans()) return;
  fill_cloud(result, odometry);
  publisher_->publish_scan(*cloud_);
}

}  // namespace nilio::daemon
