#pragma once

#include "nilio/core/result.hpp"

#include "ipc/dds/messages.hpp"
#include "ipc/dds/odometry_publisher.hpp"
#include "ipc/imu_pose_stream.hpp"

#include <memory>

namespace nilio::dds {

/// The writers of the poses at IMU rate: best effort, since a late pose is worth nothing, and their status,
/// reliable. Beside an OdometryPublisher on the same participant, but with nothing in common, so that either
/// may be used by a thread of its own. For one thread.
class ImuPosePublisher {
 public:
  static constexpr int kHistoryDepth = 5;

  /// On the participant of `publisher`, which has to outlive this; frames and prefix as there.
  static core::Result<std::unique_ptr<ImuPosePublisher>> create(OdometryPublisher& publisher,
                                                                const OdometryPublisherConfig& config);
  ~ImuPosePublisher();
  ImuPosePublisher(const ImuPosePublisher&) = delete;
  ImuPosePublisher& operator=(const ImuPosePublisher&) = delete;

  /// Each returns false when DDS refused the write.
  bool publish(const ipc::ImuPose& pose);
  bool publish_status(const ImuPoseStatus& status);
  /// Subscribers that the poses have found.
  [[nodiscard]] int subscribers() const;

 private:
  struct Entities;
  explicit ImuPosePublisher(std::unique_ptr<Entities> entities);
  std::unique_ptr<Entities> entities_;
};

/// The odometry of a pose in ROS's words; the frames are left as they are.
void fill_odometry(const ipc::ImuPose& pose, Odometry& odometry);

}  // namespace nilio::dds
