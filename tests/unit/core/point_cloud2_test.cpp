#include "core/examples/ros2_node/point_cloud2.hpp"

#include <cstdint>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

namespace {

// The members of sensor_msgs/msg/PointCloud2 that the conversion reads.
struct Field {
  std::string name;
  std::uint32_t offset = 0;
  std::uint8_t datatype = 7;
};
struct Cloud {
  struct {
    struct {
      std::int32_t sec = 1'700'000'000;
      std::uint32_t nanosec = 250'000'000;
    } stamp;
  } header;
  std::uint32_t height = 1;
  std::uint32_t width = 0;
  std::uint32_t point_step = 24;
  std::vector<Field> fields;
  std::vector<std::uint8_t> data;
};

template <class T>
void append(Cloud& cloud, T value) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(&value);
  cloud.data.insert(cloud.data.end(), bytes, bytes + sizeof value);
}

/// Two points as velodyne_pointcloud publishes them: x y z intensity ring(u16) pad time(float, s).
Cloud velodyne_cloud() {
  Cloud cloud;
  cloud.width = 2;
  cloud.fields = {{"x", 0}, {"y", 4}, {"z", 8}, {"intensity", 12}, {"ring", 16, 4}, {"time", 20}};
  for (int i = 0; i < 2; ++i) {
    for (const float v : {1.0F + static_cast<float>(i), 2.0F, -0.5F, 40.0F}) append(cloud, v);
    append(cloud, static_cast<std::uint16_t>(7 + i));
    append(cloud, std::uint16_t{0});
    append(cloud, 0.05F * static_cast<float>(i));
  }
  return cloud;
}

}  // namespace

TEST_CASE("a PointCloud2 becomes a scan with positions, rings and firing times", "[point_cloud2]") {
  nilio::core::Scan scan;
  REQUIRE(nilio_example::to_scan(velodyne_cloud(), scan).empty());
  REQUIRE(scan.points.size() == 2);
  CHECK(scan.points[1].x == 2.0F);
  CHECK(scan.points[1].z == -0.5F);
  CHECK(scan.points[1].intensity == 40.0F);
  CHECK(scan.points[1].ring == 8);
  CHECK(scan.points[1].time_offset_ns == Approx(50'000'000).margin(10));
  CHECK(scan.start.ns == 1'700'000'000'250'000'000);
  CHECK((scan.end - scan.start).seconds() == Approx(0.05));
  CHECK_FALSE(scan.motion_compensated);
}

TEST_CASE("a PointCloud2 without firing times counts as motion-compensated", "[point_cloud2]") {
  Cloud cloud = velodyne_cloud();
  cloud.fields.pop_back();
  nilio::core::Scan scan;
  REQUIRE(nilio_example::to_scan(cloud, scan).empty());
  CHECK(scan.motion_compensated);
  CHECK(scan.end == scan.start);
}

TEST_CASE("a damaged PointCloud2 is refused with the reason", "[point_cloud2]") {
  nilio::core::Scan scan;
  Cloud without_z = velodyne_cloud();
  without_z.fields.erase(without_z.fields.begin() + 2);
  CHECK(nilio_example::to_scan(without_z, scan).find("x, y, z") != std::string::npos);
  Cloud short_data = velodyne_cloud();
  short_data.data.pop_back();
  CHECK(nilio_example::to_scan(short_data, scan).find("shorter") != std::string::npos);
  Cloud beyond = velodyne_cloud();
  beyond.fields.back().offset = 22;
  CHECK(nilio_example::to_scan(beyond, scan).find("point_step") != std::string::npos);
}
