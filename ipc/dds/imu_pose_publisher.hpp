#pragma once

#include "nilio/core/result.hpp"

#include "ipc/dds/odometry_publisher.hpp"
#include "ipc/imu_pose_stream.hpp"
#include "ipc/messages/messages.hpp"

#include <memory>

namespace nilio::dds {

/// Writers of the IMU-rate poses (best effort, because a late pose is useless) and of their status
/// (reliable). Uses the participant of an OdometryPublisher but shares nothing else with it, so that each may
/// have its own thread. One thread.
class ImuPosePublisher {
 public:
  static constexpr int kHistoryDepth = 5;

  /// Creates the writers on the participant of `publisher`, which must outlive this object; same frames and
  /// prefix.
  static core::Result<std::unique_ptr<ImuPosePublisher>> create(OdometryPublisher& publisher,
                                                                const OdometryPublisherConfig& config);
  ~ImuPosePublisher();
  ImuPosePublisher(const ImuPosePublisher&) = delete;
  ImuPosePublisher& operator=(const ImuPosePublisher&) = delete;

  /// Both return false if DDS refused the write.
  bool publish(const ipc::ImuPose& pose);
  bool publish_status(const ImuPoseStatus& status);
  /// Number of matched subscribers of the poses.
  [[nodiscard]] int subscribers() const;

 private:
  struct Entities;
  explicit ImuPosePublisher(std::unique_ptr<Entities> entities);
  std::unique_ptr<Entities> entities_;
};

/// Fills the odometry message except for its frame names.
void fill_odometry(const ipc::ImuPose& pose, Odometry& odometry);

}  // namespace nilio::dds
