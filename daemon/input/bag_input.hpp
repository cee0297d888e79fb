#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/bag/sources.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/input.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Topics of a recording that a replay uses; empty names: none.
struct BagTopics {
  std::string lidar;
  drivers::BagContent lidar_content = drivers::BagContent::kOther;  ///< packets or clouds
  std::string imu;
  drivers::BagContent imu_content = drivers::BagContent::kOther;  ///< IMU messages or CAN frames
};

/// The IMU is a topic of the bag, or another file beside it.
enum class ImuPlace : std::uint8_t { kBag, kElsewhere };

/// Chooses the topics by their type where that is unambiguous, otherwise those of section `recording`;
/// packets before clouds. The error lists the topics with their rates. `bag` names the recording in messages.
core::Result<BagTopics> choose_bag_topics(const drivers::BagSurvey& survey, const Config& config,
                                          const std::string& bag, ImuPlace imu = ImuPlace::kBag);

/// Lines "  /points  sensor_msgs/PointCloud2  10.0 Hz", one for each topic.
std::string list_topics(const drivers::BagSurvey& survey);

/// Opens LiDAR and, with kBag, IMU of a ROS bag. Extrinsics follow from /tf_static: with recording.base_frame
/// both, otherwise that of the IMU relative to the LiDAR if neither is configured.
core::Result<Input> open_bag_replay(const std::vector<std::string>& bags, const Config& config,
                                    ImuPlace imu = ImuPlace::kBag);

}  // namespace nilio::daemon
