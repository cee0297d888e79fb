#include "ipc/dds/types.hpp"

#include "ipc/dds/participant.hpp"

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

#include <catch2/catch.hpp>
#include <fastdds/rtps/common/SerializedPayload.h>

namespace {

using namespace nilio::dds;
using Payload = eprosima::fastrtps::rtps::SerializedPayload_t;

Odometry sample_odometry() {
  Odometry odometry;
  odometry.stamp = {1'700'000'000'123'456'789};
  odometry.frame_id = "odom";
  odometry.child_frame_id = "base_link";
  odometry.position = {1.5, -2.25, 1e300};
  odometry.orientation_xyzw = {0.5, -0.5, 0.5, -0.5};
  for (std::size_t i = 0; i < 36; ++i) {
    odometry.pose_covariance[i] = static_cast<double>(i) + 0.125;
    odometry.twist_covariance[i] = -static_cast<double>(i) - 0.25;
  }
  odometry.linear_velocity = {10.0, 11.0, 12.0};
  odometry.angular_velocity = {-0.1, 0.2, -0.3};
  return odometry;
}

TransformMessage sample_transforms() {
  TransformMessage message;
  for (int i = 0; i < 3; ++i) {
    TransformStamped transform;
    transform.stamp = {i * 1'000'000'001};
    transform.frame_id = std::string(static_cast<std::size_t>(i), 'f');
    transform.child_frame_id = "child" + std::to_string(i);
    transform.translation = {1.0 * i, 2.0, 3.0};
    message.transforms.push_back(transform);
  }
  return message;
}

DiagnosticArray sample_diagnostics() {
  DiagnosticArray array;
  array.stamp = {1'700'000'000'000'000'001};
  array.statuses = {
      {DiagnosticStatus::Level::kError, "nilio: IMU", "not used", "can0", {{"a", "1"}, {"", ""}}},
      {DiagnosticStatus::Level::kOk, "", "", "", {}}};
  return array;
}

LatencyReport sample_report() {
  LatencyReport report;
  report.stamp = {1'700'000'000'000'000'001};
  report.stages = {{"filter", 12, 1.5, 1.75, 2.5, 3.0, 3.5, {{1.0, 2.0, 7}, {2.0, 4.0, 5}}},
                   {"a much longer name", 1ULL << 60, 0.0, 1e3, 1e9, 1.5e9, 2e9, {}},
                   {"", 0, 0, 0, 0, 0, 0, {{0, 0, 0}}}};
  report.poses_published = 1;
  report.failed_writes = 2;
  report.ring_dropped = 3;
  report.ring_high_water = 4;
  report.imu_poses_published = 5;
  report.imu_ring_dropped = 6;
  report.imu_ring_high_water = 7;
  return report;
}

ScanReport sample_scan_report() {
  ScanReport report;
  report.stamp = {1'700'000'000'100'000'002};
  report.scan_start = {1'700'000'000'000'000'003};
  report.sequence = 1ULL << 40;
  report.state = "tracking";
  report.stop_reason = "converged";
  report.delivered = {1'700'000'000'120'000'000};
  report.host_id = "5c2e";
  report.stages = {{"received", 1}, {"", -2}, {"written", 1LL << 50}};
  report.imu_used = true;
  report.degenerate_axes = 0x21;
  report.coverage_deg = 359.5F;
  report.points = 1;
  report.points_used = 2;
  report.correspondences = 3;
  report.coarse_iterations = 4;
  report.fine_iterations = 5;
  report.map_voxels = 6;
  report.lost_packets = 7;
  report.missing_firings = 8;
  report.superseded = 9;
  report.degradation_level = "icp_only";
  report.guarded = true;
  report.overshoot_ns = -10;
  for (std::size_t i = 0; i < 36; ++i) report.drift_covariance[i] = static_cast<double>(i) - 0.375;
  return report;
}

PointCloud2 sample_cloud() {
  PointCloud2 cloud;
  cloud.stamp = {1'700'000'000'000'000'009};
  cloud.frame_id = "odom";
  cloud.width = 3;
  cloud.fields = {{"x", 0, PointField::kFloat32, 1}, {"", 4, 2, 7}};
  cloud.point_step = 5;
  cloud.row_step = 15;
  for (std::uint8_t i = 0; i < 15; ++i) cloud.data.push_back(static_cast<std::uint8_t>(17 * i));
  return cloud;
}

Path sample_path() {
  Path path;
  path.stamp = {2'000'000'003};
  path.frame_id = "map";
  for (int i = 0; i < 3; ++i)
    path.poses.push_back({{i * 1'000'000'001},
                          std::string(static_cast<std::size_t>(i), 'm'),
                          {1.5 * i, -2.0, 1e-9},
                          {0.5, -0.5, 0.5, -0.5}});
  return path;
}

ImuPoseStatus sample_imu_status() { return {{5}, {4}, 6, 0.25, -0.125, true, false, 7, 8, 9, 10}; }

template <class Type, class Message>
std::vector<std::uint8_t> bytes_of(Type& type, Message message) {
  Payload payload(type.getSerializedSizeProvider(&message)());
  REQUIRE(type.serialize(&message, &payload));
  REQUIRE(payload.length == payload.max_size);  // the announced size is the size written
  return {payload.data, payload.data + payload.length};
}

template <class Type, class Message>
bool read_into(Type& type, const std::vector<std::uint8_t>& bytes, Message& message) {
  Payload payload(static_cast<std::uint32_t>(bytes.size()));
  std::copy(bytes.begin(), bytes.end(), payload.data);
  payload.length = static_cast<std::uint32_t>(bytes.size());
  return type.deserialize(&payload, &message);
}

template <class Type, class Message>
void check_round_trip(const Message& message) {
  Type type;
  Message copy;
  REQUIRE(read_into(type, bytes_of(type, message), copy));
  CHECK(copy == message);
}

// Every truncation and many random corruptions must be either rejected or read.
template <class Type, class Message>
void check_survives_damage(const Message& message) {
  Type type;
  const std::vector<std::uint8_t> good = bytes_of(type, message);
  for (std::size_t length = 0; length < good.size(); ++length) {
    Message copy;
    REQUIRE_FALSE(read_into(type, {good.begin(), good.begin() + static_cast<std::ptrdiff_t>(length)}, copy));
  }
  std::mt19937 random(11);
  int refused = 0;
  for (int i = 0; i < 20'000; ++i) {
    std::vector<std::uint8_t> bad = good;
    const auto changes = 1 + random() % 8;
    for (unsigned change = 0; change < changes; ++change)
      bad[random() % std::min<std::size_t>(bad.size(), 64)] = static_cast<std::uint8_t>(random());
    Message copy;
    refused += read_into(type, bad, copy) ? 0 : 1;
  }
  CHECK(refused > 0);
}

}  // namespace

TEST_CASE("the types have their ROS 2 names in DDS", "[types]") {
  CHECK(std::string(OdometryType().getName()) == "nav_msgs::msg::dds_::Odometry_");
  CHECK(std::string(TransformType().getName()) == "tf2_msgs::msg::dds_::TFMessage_");
  CHECK(std::string(LatencyReportType().getName()) == "nilio::msg::dds_::LatencyReport_");
  CHECK(std::string(DiagnosticArrayType().getName()) == "diagnostic_msgs::msg::dds_::DiagnosticArray_");
  CHECK(std::string(ScanReportType().getName()) == "nilio::msg::dds_::ScanReport_");
  CHECK(std::string(ImuPoseStatusType().getName()) == "nilio::msg::dds_::ImuPoseStatus_");
  CHECK(std::string(PointCloud2Type().getName()) == "sensor_msgs::msg::dds_::PointCloud2_");
  CHECK(std::string(PathType().getName()) == "nav_msgs::msg::dds_::Path_");
}

TEST_CASE("messages are unchanged after serialization and deserialization", "[types]") {
  check_round_trip<OdometryType>(sample_odometry());
  check_round_trip<OdometryType>(Odometry{});
  check_round_trip<TransformType>(sample_transforms());
  check_round_trip<TransformType>(TransformMessage{});
  check_round_trip<LatencyReportType>(sample_report());
  check_round_trip<LatencyReportType>(LatencyReport{});
  check_round_trip<DiagnosticArrayType>(sample_diagnostics());
  check_round_trip<DiagnosticArrayType>(DiagnosticArray{});
  check_round_trip<ScanReportType>(sample_scan_report());
  check_round_trip<ScanReportType>(ScanReport{});
  check_round_trip<ImuPoseStatusType>(sample_imu_status());
  check_round_trip<PointCloud2Type>(sample_cloud());
  check_round_trip<PointCloud2Type>(PointCloud2{});
  check_round_trip<PathType>(sample_path());
  check_round_trip<PathType>(Path{});
}

TEST_CASE("times before 1970 have nanoseconds in the valid range", "[types]") {
  Odometry odometry = sample_odometry();
  odometry.stamp = {-1};
  check_round_trip<OdometryType>(odometry);
  OdometryType type;
  const auto bytes = bytes_of(type, odometry);
  const std::vector<std::uint8_t> stamp(bytes.begin() + 4, bytes.begin() + 12);
  CHECK(stamp ==
        std::vector<std::uint8_t>{0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xC9, 0x9A, 0x3B});  // -1 s + 999,999,999 ns
}

TEST_CASE("an odometry message has the expected bytes on the wire", "[types]") {
  Odometry odometry;
  odometry.stamp = {2 * 1'000'000'000LL + 3};
  odometry.frame_id = "odom";
  odometry.child_frame_id = "base_link";
  odometry.position = {1.0, -2.0, 0.5};
  odometry.orientation_xyzw = {0.0, 0.0, 0.0, 1.0};
  odometry.pose_covariance[35] = 4.0;
  odometry.linear_velocity[0] = 8.0;
  odometry.angular_velocity[2] = 0.25;
  odometry.twist_covariance[0] = 16.0;
  std::vector<std::uint8_t> expected{
      0x00, 0x01, 0x00, 0x00,                                                          // CDR, little endian
      0x02, 0x00, 0x00, 0x00, 0x03, 0x00, 0x00, 0x00,                                  // sec, nanosec
      0x05, 0x00, 0x00, 0x00, 'o',  'd',  'o',  'm',  0x00,                            // frame_id
      0x00, 0x00, 0x00,                                                                // aligned to 4
      0x0A, 0x00, 0x00, 0x00, 'b',  'a',  's',  'e',  '_',  'l', 'i', 'n', 'k', 0x00,  // child_frame_id
      0x00, 0x00, 0x00, 0x00, 0x00, 0x00,              // aligned to 8 after the encapsulation
      0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0xF0, 0x3F,  // x
      0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0xC0,  // y
      0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0xE0, 0x3F,  // z
  };
  const auto put_zeros = [&](std::size_t doubles) { expected.insert(expected.end(), 8 * doubles, 0x00); };
  const auto put_top = [&](std::uint8_t second, std::uint8_t first) {
    expected.insert(expected.end(), 6, 0x00);
    expected.insert(expected.end(), {second, first});
  };
  put_zeros(3);
  put_top(0xF0, 0x3F);  // w = 1
  put_zeros(35);
  put_top(0x10, 0x40);  // last of the pose covariance = 4
  put_top(0x20, 0x40);  // linear x = 8
  put_zeros(4);
  put_top(0xD0, 0x3F);  // angular z = 0.25
  put_top(0x30, 0x40);  // first of the twist covariance = 16
  put_zeros(35);
  OdometryType type;
  CHECK(bytes_of(type, odometry) == expected);
  CHECK(expected.size() == 4 + 40 + 8 * (7 + 36 + 6 + 36));
}

TEST_CASE("big-endian messages are read", "[types]") {
  TransformType type;
  TransformMessage message;
  // Encapsulation CDR_BE, then a sequence of one transform.
  std::vector<std::uint8_t> bytes{0, 0, 0,   0, 0, 0, 0, 1, 0, 0, 0,   7, 0, 0, 0, 9, 0, 0,
                                  0, 2, 'a', 0, 0, 0, 0, 0, 0, 2, 'b', 0, 0, 0, 0, 0, 0, 0};
  bytes.insert(bytes.end(), {0x3F, 0xF0, 0, 0, 0, 0, 0, 0});
  bytes.insert(bytes.end(), 48, 0);
  REQUIRE(read_into(type, bytes, message));
  REQUIRE(message.transforms.size() == 1);
  CHECK(message.transforms[0].stamp.ns == 7'000'000'009);
  CHECK(message.transforms[0].frame_id == "a");
  CHECK(message.transforms[0].child_frame_id == "b");
  CHECK(message.transforms[0].translation[0] == 1.0);
}

TEST_CASE("truncated and damaged payloads are rejected without an exception", "[types]") {
  check_survives_damage<OdometryType>(sample_odometry());
  check_survives_damage<TransformType>(sample_transforms());
  check_survives_damage<LatencyReportType>(sample_report());
  check_survives_damage<DiagnosticArrayType>(sample_diagnostics());
  check_survives_damage<ScanReportType>(sample_scan_report());
  check_survives_damage<ImuPoseStatusType>(sample_imu_status());
  check_survives_damage<PointCloud2Type>(sample_cloud());
  check_survives_damage<PathType>(sample_path());
}

TEST_CASE("a sequence length beyond the payload is rejected before any allocation", "[types]") {
  TransformType type;
  TransformMessage message;
  CHECK_FALSE(read_into(type, {0, 1, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF}, message));
  CHECK_FALSE(read_into(type, {0, 1, 0, 0, 0x01, 0x00, 0x00, 0x00}, message));
  CHECK(message.transforms.empty());
}

TEST_CASE("encapsulations other than plain CDR are rejected", "[types]") {
  OdometryType type;
  std::vector<std::uint8_t> bytes = bytes_of(type, sample_odometry());
  Odometry copy;
  for (const int kind : {2, 3, 6, 7, 10, 255}) {
    bytes[1] = static_cast<std::uint8_t>(kind);
    CHECK_FALSE(read_into(type, bytes, copy));
  }
  bytes[1] = 1;
  bytes[0] = 1;
  CHECK_FALSE(read_into(type, bytes, copy));
}

TEST_CASE("serialization into a payload that is too small returns false", "[types]") {
  OdometryType type;
  Odometry odometry = sample_odometry();
  Payload payload(100);
  CHECK_FALSE(type.serialize(&odometry, &payload));
}

TEST_CASE("topic names follow the prefix and ROS's naming rules", "[types]") {
  using Catch::Matchers::Contains;
  CHECK(topic_names("").value().odometry == "rt/odom");
  CHECK(topic_names("").value().transform == "rt/tf");
  CHECK(topic_names("").value().latency == "rt/nilio/latency");
  CHECK(topic_names("").value().imu_odometry == "rt/nilio/odometry_imu");
  CHECK(topic_names("car").value().imu_status == "rt/car/nilio/odometry_imu_status");
  CHECK(topic_names("car").value().scan_report == "rt/car/nilio/scan_report");
  CHECK(topic_names("car").value().diagnostics == "rt/diagnostics");
  CHECK(topic_names("").value().registered_scan == "rt/registered_scan");
  CHECK(topic_names("car").value().path == "rt/car/path");
  CHECK(topic_names("car").value().submaps == "rt/car/submaps");
  CHECK(topic_names("car").value().static_transform == "rt/tf_static");
  CHECK(topic_names("/car_1//front/").value().odometry == "rt/car_1/front/odom");
  CHECK(topic_names("car").value().transform == "rt/tf");
  for (const char* bad : {"a b", "1car", "car/2", "caf\xC3\xA9", "a-b"})
    CHECK_THAT(topic_names(bad).error().message, Contains("topic prefix"));
}

TEST_CASE("a participant rejects invalid settings with a remedy", "[types]") {
  using Catch::Matchers::Contains;
  ParticipantConfig config;
  config.domain = 233;
  CHECK_THAT(Participant::create(config).error().message, Contains("233") && Contains("0 to 232"));
  config.domain = 1;
  config.interface_whitelist = {"eth0"};
  CHECK_THAT(Participant::create(config).error().message, Contains("eth0") && Contains("127.0.0.1"));
  config.interface_whitelist = {"203.0.113.77"};
  CHECK_THAT(Participant::create(config).error().message, Contains("203.0.113.77") && Contains("127.0.0.1"));
}
