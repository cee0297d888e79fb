#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/bag/bag.hpp"
#include "nilio/drivers/packet.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::drivers {

/// Content of the messages of a topic, by their type.
enum class BagContent : std::uint8_t {
  kPackets,     ///< velodyne_msgs/VelodyneScan and VelodynePacket, nebula_msgs/NebulaPackets, PacketMsg
  kCloud,       ///< sensor_msgs/PointCloud2, livox_ros_driver(2)/CustomMsg
  kImu,         ///< sensor_msgs/Imu
  kCanFrame,    ///< can_msgs/Frame
  kFix,         ///< sensor_msgs/NavSatFix
  kSentence,    ///< nmea_msgs/Sentence
  kTransforms,  ///< tf2_msgs/TFMessage
  kPose,        ///< nav_msgs/Odometry, geometry_msgs/PoseStamped, PoseWithCovarianceStamped, TransformStamped
  kOther,
};
BagContent content_of(const BagTopic& topic);
/// Why the messages of a topic of known content cannot be decoded: another definition than the published one
/// (by its checksum), or another serialization. Empty if they can.
std::string why_undecodable(const BagTopic& topic);

struct BagHeader {
  core::Time stamp;
  std::string frame_id;  ///< without a leading slash
};

/// sensor_msgs/Imu.
struct BagImu {
  BagHeader header;
  core::ImuSample sample;
  bool has_angular_velocity = true;  ///< false where the message says so (covariance -1)
  bool has_linear_acceleration = true;
};

/// sensor_msgs/NavSatFix.
struct BagFix {
  BagHeader header;
  int status = -1;  ///< -1 none, also without a position; 0 fix, 1 SBAS, 2 GBAS
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  double altitude_m = 0.0;              ///< above the ellipsoid; not finite where it is unknown
  std::array<double, 3> variance_m2{};  ///< east, north, up; valid if `covariance_type` > 0
  int covariance_type = 0;
};

/// nmea_msgs/Sentence.
struct BagSentence {
  BagHeader header;
  std::string sentence;
};

/// geometry_msgs/TransformStamped.
struct BagTransform {
  std::string parent;
  std::string child;
  core::SE3 T_parent_child;
};

/// Pose of a body in the header's frame: nav_msgs/Odometry, geometry_msgs/PoseStamped,
/// PoseWithCovarianceStamped, TransformStamped.
struct BagPose {
  BagHeader header;
  core::SE3 pose;
};

/// Column of a point cloud.
struct CloudField {
  std::string name;
  std::uint32_t offset = 0;
  std::uint8_t type =
      0;  ///< sensor_msgs/PointField: 1 int8 2 uint8 3 int16 4 uint16 5 int32 6 uint32 7 float32 8 float64
};
/// Size of a type of PointField; 0 if it is none.
std::size_t size_of_field(std::uint8_t type);

/// Points as columns, of a sensor_msgs/PointCloud2 or a file. The data are checked: `points` elements of
/// `step` bytes are there, and all fields lie within a step.
struct CloudView {
  BagHeader header;
  core::Time received;  ///< receive time of the recording; that of the header where there is none
  std::uint32_t height = 1;
  std::uint32_t width = 0;
  std::vector<CloudField> fields;
  bool big_endian = false;
  std::uint32_t step = 0;
  std::size_t points = 0;
  std::span<const std::uint8_t> data;  ///< valid as long as the message
};

// Decoding of one message. Empty for damaged or truncated bytes, and for values that are not finite where
// numbers are needed.
std::optional<BagImu> decode_imu(const BagTopic& topic, const BagMessage& message);
std::optional<BagFix> decode_fix(const BagTopic& topic, const BagMessage& message);
std::optional<BagSentence> decode_sentence(const BagTopic& topic, const BagMessage& message);
std::optional<CanFrame> decode_can_frame(const BagTopic& topic, const BagMessage& message);
std::optional<BagPose> decode_pose(const BagTopic& topic, const BagMessage& message);
/// Appends the transforms; false if the message is damaged.
bool decode_transforms(const BagTopic& topic, const BagMessage& message,
                       std::vector<BagTransform>& transforms);
/// Appends the packets with their own stamps, or the receive time where a packet has none; false if the
/// message is damaged. Packets carry the factory ports of data and position packets, by their size, and no
/// sender.
bool decode_packets(const BagTopic& topic, const BagMessage& message, std::vector<Packet>& packets);
/// Fills `cloud`, whose buffers are reused; false if the message is damaged or contradicts itself.
bool decode_cloud(const BagTopic& topic, const BagMessage& message, CloudView& cloud);

}  // namespace nilio::drivers
