#include "nilio/drivers/bag/messages.hpp"

#include "nilio/drivers/velodyne/model.hpp"

#include "drivers/bag/wire.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <linux/can.h>
#include <string_view>

namespace nilio::drivers {

namespace {

using bag::WireReader;

constexpr std::uint16_t kDataPort = 2368;
constexpr std::uint16_t kPositionPort = 8308;
constexpr std::uint32_t kMaxFields = 64;
constexpr std::uint32_t kMaxStep = 1024;
constexpr std::size_t kMaxName = 256;

struct KnownType {
  std::string_view type;
  BagContent content;
  /// Checksum of the ROS 1 definition; empty: unknown, and not compared.
  std::string_view md5;
};
constexpr std::array<KnownType, 18> kKnownTypes{{
    {"velodyne_msgs/VelodyneScan", BagContent::kPackets, "50804fc9533a0e579e6322c04ae70566"},
    {"velodyne_msgs/VelodynePacket", BagContent::kPackets, ""},
    {"nebula_msgs/NebulaPackets", BagContent::kPackets, ""},
    {"ouster_ros/PacketMsg", BagContent::kPackets, "4f7b5949e76f86d01e96b0e33ba9b5e3"},
    {"ouster_sensor_msgs/PacketMsg", BagContent::kPackets, ""},
    {"sensor_msgs/PointCloud2", BagContent::kCloud, "1158d486dd51d683ce2f1be655c3c181"},
    {"livox_ros_driver/CustomMsg", BagContent::kCloud, "e4d6829bdfe657cb6c21a746c86b21a6"},
    {"livox_ros_driver2/CustomMsg", BagContent::kCloud, "e4d6829bdfe657cb6c21a746c86b21a6"},
    {"sensor_msgs/Imu", BagContent::kImu, "6a62c6daae103f4ff57a132d6f95cec2"},
    {"can_msgs/Frame", BagContent::kCanFrame, "64ae5cebf967dc6aae4e78f5683a5b25"},
    {"sensor_msgs/NavSatFix", BagContent::kFix, "2d3a8cd499b9b4a0249fb98fd05cfa48"},
    {"nmea_msgs/Sentence", BagContent::kSentence, "9f221efc5f4b3bac7ce4af102b32308b"},
    {"tf2_msgs/TFMessage", BagContent::kTransforms, "94810edda583a504dfda3829e70d7eec"},
    {"tf/tfMessage", BagContent::kTransforms, "94810edda583a504dfda3829e70d7eec"},
    {"nav_msgs/Odometry", BagContent::kPose, "cd5e73d190d741a2f92e81eda573aca7"},
    {"geometry_msgs/PoseStamped", BagContent::kPose, "d3812c3cbc69362b77dc0b19b345f8f5"},
    {"geometry_msgs/PoseWithCovarianceStamped", BagContent::kPose, "953b798c0f514ff060a53a3498ce6246"},
    {"geometry_msgs/TransformStamped", BagContent::kPose, "b5764a33bfeb3588febc2682852579b0"},
}};

const KnownType* find_type(const std::string& type) {
  const auto* const found =
      std::ranges::find_if(kKnownTypes, [&](const KnownType& known) { return known.type == type; });
  return found == kKnownTypes.end() ? nullptr : found;
}

void read_header(WireReader& wire, BagEncoding encoding, BagHeader& header) {
  if (encoding == BagEncoding::kRos1) wire.number<std::uint32_t>();
  header.stamp = wire.time();
  std::string_view frame = wire.text();
  while (frame.starts_with('/')) frame.remove_prefix(1);
  header.frame_id.assign(frame.substr(0, kMaxName));
}

bool are_finite(std::span<const double> values) {
  return std::ranges::all_of(values, [](double value) { return std::isfinite(value); });
}

/// Position and orientation; empty for what is no rotation.
std::optional<core::SE3> read_pose(WireReader& wire) {
  const auto t = wire.doubles<3>();
  const auto q = wire.doubles<4>();
  const Eigen::Quaterniond rotation(q[3], q[0], q[1], q[2]);
  if (!wire.ok() || !are_finite(t) || !are_finite(q) || std::abs(rotation.norm() - 1.0) >= 0.1)
    return std::nullopt;
  return core::SE3{rotation.normalized(), core::Vector3(t[0], t[1], t[2])};
}

Packet& append_packet(std::span<const std::uint8_t> bytes, core::Time stamp, core::Time received,
                      std::vector<Packet>& packets) {
  Packet& packet = packets.emplace_back();
  packet.stamp = stamp.ns > 0 ? stamp : received;
  packet.truncated = bytes.size() > packet.data.size();
  packet.size = static_cast<std::uint16_t>(std::min(bytes.size(), packet.data.size()));
  std::copy_n(bytes.begin(), packet.size, packet.data.begin());
  packet.sender_port = packet.destination_port =
      packet.size == kPositionPacketSize ? kPositionPort : kDataPort;
  return packet;
}

/// Fixed columns of a Livox point: 19 bytes, in CDR padded to 20 but for the last one.
const std::vector<CloudField>& livox_fields() {
  static const std::vector<CloudField> fields{
      {"offset_time", 0, 6},   {"x", 4, 7},    {"y", 8, 7},    {"z", 12, 7},
      {"reflectivity", 16, 2}, {"tag", 17, 2}, {"line", 18, 2}};
  return fields;
}
constexpr std::uint32_t kLivoxPointBytes = 19;

bool decode_livox(WireReader& wire, BagEncoding encoding, CloudView& cloud) {
  const auto base_ns = static_cast<std::int64_t>(wire.number<std::uint64_t>());
  wire.number<std::uint32_t>();
  wire.bytes(4);
  const std::uint32_t count = wire.count(kLivoxPointBytes);
  if (!wire.ok() || wire.is_swapped()) return false;
  // Offsets count from the time base; without time synchronisation it is another clock than the header's.
  if (std::abs(static_cast<double>(base_ns) - static_cast<double>(cloud.header.stamp.ns)) < 1e9)
    cloud.header.stamp.ns = base_ns;
  cloud.fields = livox_fields();
  cloud.step = encoding == BagEncoding::kCdr ? 20 : kLivoxPointBytes;
  cloud.height = 1;
  cloud.width = count;
  cloud.big_endian = false;
  cloud.data = wire.bytes(wire.remaining());
  // The last point has no padding.
  const std::size_t whole = cloud.data.size() / cloud.step;
  const bool has_short_end = cloud.data.size() % cloud.step >= kLivoxPointBytes;
  cloud.points = std::min<std::size_t>(count, whole + (has_short_end ? 1 : 0));
  return count > 0;
}

}  // namespace

BagContent content_of(const BagTopic& topic) {
  const KnownType* const known = find_type(topic.type);
  return known == nullptr ? BagContent::kOther : known->content;
}

std::string why_undecodable(const BagTopic& topic) {
  const KnownType* const known = find_type(topic.type);
  if (known == nullptr) return {};
  if (topic.encoding == BagEncoding::kOther)
    return topic.name + " (" + topic.type + ") is serialized neither as ROS 1 nor as CDR";
  if (topic.encoding == BagEncoding::kRos1 && !known->md5.empty() && !topic.md5.empty() && topic.md5 != "*" &&
      topic.md5 != known->md5)
    return topic.name + " (" + topic.type + ") has another definition (md5 " + topic.md5.substr(0, 32) +
           ") than the published one (" + std::string(known->md5) + ")";
  return {};
}

std::size_t size_of_field(std::uint8_t type) {
  constexpr std::array<std::size_t, 9> kSizes{0, 1, 1, 2, 2, 4, 4, 4, 8};
  return type < kSizes.size() ? kSizes[type] : 0;
}

std::optional<BagImu> decode_imu(const BagTopic& topic, const BagMessage& message) {
  WireReader wire(message.data, topic.encoding);
  BagImu imu;
  read_header(wire, topic.encoding, imu.header);
  wire.doubles<4>();
  wire.doubles<9>();
  imu.sample.angular_velocity = wire.doubles<3>();
  imu.has_angular_velocity = wire.doubles<9>()[0] != -1.0;
  imu.sample.linear_acceleration = wire.doubles<3>();
  imu.has_linear_acceleration = wire.doubles<9>()[0] != -1.0;
  imu.sample.stamp = imu.header.stamp.ns > 0 ? imu.header.stamp : message.stamp;
  const bool valid =
      wire.ok() && are_finite(imu.sample.angular_velocity) && are_finite(imu.sample.linear_acceleration);
  return valid ? std::optional(std::move(imu)) : std::nullopt;
}

std::optional<BagFix> decode_fix(const BagTopic& topic, const BagMessage& message) {
  WireReader wire(message.data, topic.encoding);
  BagFix fix;
  read_header(wire, topic.encoding, fix.header);
  fix.status = wire.number<std::int8_t>();
  wire.number<std::uint16_t>();
  const auto place = wire.doubles<3>();
  const auto covariance = wire.doubles<9>();
  fix.latitude_deg = place[0];
  fix.longitude_deg = place[1];
  fix.altitude_m = place[2];
  fix.variance_m2 = {covariance[0], covariance[4], covariance[8]};
  fix.covariance_type = wire.number<std::uint8_t>();
  if (fix.header.stamp.ns <= 0) fix.header.stamp = message.stamp;
  // Drivers fill the position of a receiver without a fix with zeros or what is no number.
  const bool has_place = are_finite(std::span(place).first(2)) && (place[0] != 0.0 || place[1] != 0.0);
  if (!has_place) fix.status = -1;
  const bool valid = wire.ok() && (!has_place || (std::abs(place[0]) <= 90.0 && std::abs(place[1]) <= 180.0));
  return valid ? std::optional(std::move(fix)) : std::nullopt;
}

std::optional<BagSentence> decode_sentence(const BagTopic& topic, const BagMessage& message) {
  WireReader wire(message.data, topic.encoding);
  BagSentence sentence;
  read_header(wire, topic.encoding, sentence.header);
  sentence.sentence = wire.text();
  if (sentence.header.stamp.ns <= 0) sentence.header.stamp = message.stamp;
  return wire.ok() ? std::optional(std::move(sentence)) : std::nullopt;
}

std::optional<CanFrame> decode_can_frame(const BagTopic& topic, const BagMessage& message) {
  WireReader wire(message.data, topic.encoding);
  BagHeader header;
  read_header(wire, topic.encoding, header);
  CanFrame frame;
  frame.stamp = header.stamp.ns > 0 ? header.stamp : message.stamp;
  frame.id = wire.number<std::uint32_t>();
  frame.remote = wire.number<std::uint8_t>() != 0;
  frame.extended = wire.number<std::uint8_t>() != 0;
  frame.error = wire.number<std::uint8_t>() != 0;
  frame.length = wire.number<std::uint8_t>();
  const auto data = wire.bytes(8);
  if (!wire.ok() || frame.length > 8 || frame.id > (frame.extended ? CAN_EFF_MASK : CAN_SFF_MASK))
    return std::nullopt;
  std::ranges::copy(data, frame.data.begin());
  return frame;
}

std::optional<BagPose> decode_pose(const BagTopic& topic, const BagMessage& message) {
  WireReader wire(message.data, topic.encoding);
  BagPose result;
  read_header(wire, topic.encoding, result.header);
  // The name of the body's frame lies between header and pose.
  if (topic.type == "nav_msgs/Odometry" || topic.type == "geometry_msgs/TransformStamped") wire.text();
  const auto pose = read_pose(wire);
  if (!pose) return std::nullopt;
  result.pose = *pose;
  if (result.header.stamp.ns <= 0) result.header.stamp = message.stamp;
  return result;
}

bool decode_transforms(const BagTopic& topic, const BagMessage& message,
                       std::vector<BagTransform>& transforms) {
  constexpr std::size_t kSmallest = 72;
  WireReader wire(message.data, topic.encoding);
  const std::uint32_t count = wire.count(kSmallest);
  for (std::uint32_t i = 0; i < count && wire.ok(); ++i) {
    BagHeader header;
    read_header(wire, topic.encoding, header);
    std::string_view child = wire.text();
    while (child.starts_with('/')) child.remove_prefix(1);
    const auto pose = read_pose(wire);
    if (!pose) return false;
    transforms.push_back({header.frame_id, std::string(child.substr(0, kMaxName)), *pose});
  }
  return wire.ok();
}

bool decode_packets(const BagTopic& topic, const BagMessage& message, std::vector<Packet>& packets) {
  WireReader wire(message.data, topic.encoding);
  if (topic.type == "velodyne_msgs/VelodynePacket") {
    const core::Time stamp = wire.time();
    const auto data = wire.bytes(kDataPacketSize);
    if (wire.ok()) append_packet(data, stamp, message.stamp, packets);
    return wire.ok();
  }
  if (topic.type.ends_with("/PacketMsg")) {
    const auto data = wire.blob();
    if (wire.ok()) append_packet(data, {}, message.stamp, packets);
    return wire.ok();
  }
  BagHeader header;
  read_header(wire, topic.encoding, header);
  const bool has_lengths = topic.type == "nebula_msgs/NebulaPackets";
  const std::uint32_t count = wire.count(has_lengths ? 12 : 8 + kDataPacketSize);
  for (std::uint32_t i = 0; i < count; ++i) {
    const core::Time stamp = wire.time();
    const auto data = has_lengths ? wire.blob() : wire.bytes(kDataPacketSize);
    if (!wire.ok()) return false;
    append_packet(data, stamp, message.stamp, packets);
  }
  return wire.ok();
}

bool decode_cloud(const BagTopic& topic, const BagMessage& message, CloudView& cloud) {
  WireReader wire(message.data, topic.encoding);
  read_header(wire, topic.encoding, cloud.header);
  cloud.received = message.stamp;
  if (topic.type != "sensor_msgs/PointCloud2") return decode_livox(wire, topic.encoding, cloud);
  cloud.height = wire.number<std::uint32_t>();
  cloud.width = wire.number<std::uint32_t>();
  const std::uint32_t fields = wire.count(13);
  if (fields > kMaxFields) return false;
  cloud.fields.clear();
  for (std::uint32_t i = 0; i < fields; ++i) {
    CloudField field;
    field.name = wire.text().substr(0, kMaxName);
    field.offset = wire.number<std::uint32_t>();
    field.type = wire.number<std::uint8_t>();
    wire.number<std::uint32_t>();
    cloud.fields.push_back(std::move(field));
  }
  cloud.big_endian = wire.number<std::uint8_t>() != 0;
  cloud.step = wire.number<std::uint32_t>();
  wire.number<std::uint32_t>();
  cloud.data = wire.blob();
  if (!wire.ok() || cloud.step == 0 || cloud.step > kMaxStep) return false;
  // Drivers write wrong row steps: the points are those that are there.
  const std::uint64_t declared = static_cast<std::uint64_t>(cloud.height) * cloud.width;
  cloud.points = static_cast<std::size_t>(std::min<std::uint64_t>(declared, cloud.data.size() / cloud.step));
  std::erase_if(cloud.fields, [&](const CloudField& field) {
    const std::size_t size = size_of_field(field.type);
    return size == 0 || size > cloud.step || field.offset > cloud.step - size;
  });
  return true;
}

}  // namespace nilio::drivers
