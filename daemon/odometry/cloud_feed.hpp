#pragma once

#include "nilio/core/odometry.hpp"

#include "ipc/mapper_process.hpp"
#include "ipc/publisher_process.hpp"
#include "ipc/scan_cloud.hpp"

#include <memory>
#include <optional>

namespace nilio::daemon {

/// Passes registered scans and the poses of the path on to nilio-publisher, and keyframes to nilio-mapper,
/// for the odometry thread. Neither allocates nor waits after construction; a scan is copied only if it is a
/// keyframe or somebody subscribes.
class CloudFeed {
 public:
  /// Both may be null, and must outlive the feed.
  CloudFeed(ipc::PublisherProcess* publisher, ipc::MapperProcess* mapper)
      : publisher_(publisher), mapper_(mapper) {}

  /// Call after Odometry::update_map(), with its result.
  void add(const core::OdometryResult& result, const core::Odometry& odometry);
  /// Whether the next add() of this result writes a keyframe, for hosts that wait until there is room for it.
  [[nodiscard]] bool is_keyframe(const core::OdometryResult& result) const;

 private:
  void fill_cloud(const core::OdometryResult& result, const core::Odometry& odometry);
  void add_to_path(const core::OdometryResult& result);

  ipc::PublisherProcess* publisher_;
  ipc::MapperProcess* mapper_;
  std::unique_ptr<ipc::ScanCloud> cloud_ = std::make_unique<ipc::ScanCloud>();
  /// Last pose of the path.
  std::optional<core::SE3> T_odom_path_;
  std::optional<core::SE3> T_odom_keyframe_;
};

}  // namespace nilio::daemon
