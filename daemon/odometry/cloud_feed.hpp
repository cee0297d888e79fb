#pragma once

#include "nilio/core/odometry.hpp"

#include "ipc/publisher_process.hpp"
#include "ipc/scan_cloud.hpp"

#include <memory>
#include <optional>

namespace nilio::daemon {

/// Passes registered scans and the poses of the path on to nilio-publisher, for the odometry thread. Neither
/// allocates nor waits after construction; a scan is copied only while somebody subscribes.
class CloudFeed {
 public:
  /// `publisher` may be null, and must outlive the feed.
  explicit CloudFeed(ipc::PublisherProcess* publisher) : publisher_(publisher) {}

  /// Call after Odometry::update_map(), with its result.
  void add(const core::OdometryResult& result, const core::Odometry& odometry);

 private:
  void fill_cloud(const core::OdometryResult& result, const core::Odometry& odometry);
  void add_to_path(const core::OdometryResult& result);

  ipc::PublisherProcess* publisher_;
  std::unique_ptr<ipc::ScanCloud> cloud_ = std::make_unique<ipc::ScanCloud>();
  /// Last pose of the path.
  std::optional<core::SE3> T_odom_path_;
};

}  // namespace nilio::daemon
