#include "ipc/dds/map_publisher.hpp"

#include "tests/support/dds_support.hpp"

#include <array>
#include <chrono>
#include <cstring>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include <catch2/catch.hpp>

namespace {

using namespace nilio;
using namespace nilio::tests;

std::unique_ptr<dds::MapPublisher> make_map_publisher(std::uint32_t domain, int kept_submaps) {
  dds::MapPublisherConfig config;
  config.participant = loopback(domain);
  config.kept_submaps = kept_submaps;
  auto publisher = dds::MapPublisher::create(config);
  if (!publisher) FAIL(publisher.error().message);
  return std::move(publisher).value();
}

std::string hex_of(const dds::SurfacePoint& point) {
  std::array<std::uint8_t, sizeof point> bytes{};
  std::memcpy(bytes.data(), &point, bytes.size());
  std::string text;
  std::array<char, 3> digits{};
  for (const std::uint8_t byte : bytes) {
    std::snprintf(digits.data(), digits.size(), "%02x", byte);
    text += digits.data();
  }
  return text;
}

std::string cloud_line(int seconds, const std::vector<dds::SurfacePoint>& points) {
  std::string line = "cloud " + std::to_string(seconds) + " 1 map - 1 " + std::to_string(points.size());
  int offset = 0;
  for (const char* const name :
       {"x", "y", "z", "intensity", "normal_x", "normal_y", "normal_z", "curvature"}) {
    line += std::string(" [") + name + " " + std::to_string(offset) + " 7 1]";
    offset += 4;
  }
  line += " 0 32 " + std::to_string(32 * points.size()) + " 1 ";
  for (const dds::SurfacePoint& point : points) line += hex_of(point);
  return line;
}

core::Time at(int seconds) { return {seconds * 1'000'000'000LL + 1}; }

std::string reader_command(const std::filesystem::path& program, std::uint32_t domain, int submaps) {
  return kCycloneLoopback + program.string() + " " + std::to_string(domain) + " " + std::to_string(submaps) +
         " 30 map";
}

}  // namespace

TEST_CASE("a CycloneDDS reader that comes late gets the kept submaps, their poses and the last correction",
          "[map_publisher]") {
  const auto program = built_program("nilio-cyclone-reader");
  if (!program) return;
  const std::uint32_t domain = test_domain();
  const auto publisher = make_map_publisher(domain, 3);
  dds::Path poses;
  std::vector<std::vector<dds::SurfacePoint>> submaps;
  for (int i = 0; i < 5; ++i) {
    const auto x = static_cast<float>(i);
    submaps.push_back({{x, -2.5F, 0.25F, 200.0F, 0.0F, 0.6F, 0.8F, 0.01F}, {x, 1.0F, 2.0F, 3.0F, 1.0F}});
    REQUIRE(publisher->publish_submap(at(100 + i), submaps.back()));
    poses.stamp = at(100 + i);
    poses.poses.push_back({at(100 + i), "", {1.0 * i, -2.0, 0.5}, {0.5, -0.5, 0.5, -0.5}});
    REQUIRE(publisher->publish_poses(poses));
  }
  REQUIRE(publisher->publish_transform(at(50), core::SE3{}));
  core::SE3 T_map_odom;
  T_map_odom.translation = {0.5, -1.0, 0.25};
  T_map_odom.rotation = Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5);
  REQUIRE(publisher->publish_transform(at(104), T_map_odom));
  REQUIRE(publisher->publish_correction({at(104), "loop 4-0", 2, 1.25, 0.01, true}));
  CHECK(publisher->local_map_subscribers() == 0);
  Program reader(reader_command(*program, domain, 3));
  REQUIRE(eventually([&] { return publisher->local_map_subscribers() == 1; }));
  REQUIRE(reader.line() == "ready");
  const std::vector<dds::SurfacePoint> local_map(3, {9.0F, 8.0F, 7.0F, 6.0F, 0.0F, 0.0F, 1.0F, 0.5F});
  REQUIRE(publisher->publish_local_map(at(900), local_map));
  std::vector<std::string> clouds;
  std::vector<std::string> others;
  while (const auto line = reader.line()) (line->starts_with("cloud") ? clouds : others).push_back(*line);
  CHECK(reader.exit_status() == 0);
  // The two oldest are not kept.
  REQUIRE(clouds.size() == 4);
  for (int i = 2; i < 5; ++i) {
    const std::string line = cloud_line(100 + i, submaps[static_cast<std::size_t>(i)]);
    CHECK(std::count(clouds.begin(), clouds.end(), line) == 1);
  }
  CHECK(std::count(clouds.begin(), clouds.end(), cloud_line(900, local_map)) == 1);
  REQUIRE(others.size() == 3);
  std::string path = "path 104 1 map -";
  for (int i = 0; i < 5; ++i) {
    std::array<char, 64> x{};
    std::snprintf(x.data(), x.size(), "%a", 1.0 * i);
    path += " pose " + std::to_string(100 + i) + " 1 map - " + x.data() +
            " -0x1p+1 0x1p-1 0x1p-1 -0x1p-1 0x1p-1 -0x1p-1";
  }
  CHECK(std::count(others.begin(), others.end(), path) == 1);
  CHECK(std::count(others.begin(), others.end(),
                   "transform 104 1 map odom 0x1p-1 -0x1p+0 0x1p-2 0x1p-1 -0x1p-1 0x1p-1 0x1p-1") == 1);
  CHECK(std::count(others.begin(), others.end(),
                   "diagnostics 0 [nilio: map to odom] [loop 4-0] [loops=2] [distance_m=1.2500] "
                   "[angle_deg=0.5730] [mode=jump]") == 1);
}

TEST_CASE("twenty submaps of a drive reach a late reader within seconds", "[map_publisher][timed]") {
  const auto program = built_program("nilio-cyclone-reader");
  if (!program) return;
  const std::uint32_t domain = test_domain();
  const auto publisher = make_map_publisher(domain, 20);
  // As many surfaces as 64 beams give.
  const std::vector<dds::SurfacePoint> points(20'000, {1.0F, 2.0F, 3.0F, 4.0F, 0.0F, 0.0F, 1.0F, 0.01F});
  for (int i = 0; i < 20; ++i) REQUIRE(publisher->publish_submap(at(100 + i), points));
  dds::Path poses;
  REQUIRE(publisher->publish_poses(poses));
  REQUIRE(publisher->publish_transform(at(100), core::SE3{}));
  REQUIRE(publisher->publish_correction({}));
  Program reader(reader_command(*program, domain, 20));
  REQUIRE(eventually([&] { return publisher->local_map_subscribers() == 1; }));
  REQUIRE(reader.line() == "ready");
  const auto begin = std::chrono::steady_clock::now();
  // The local map competes for the link, as it does behind the mapper: every second, the last one kept.
  const std::jthread local_map([&](const std::stop_token& stop) {
    for (int i = 0; !stop.stop_requested(); ++i) {
      if (i % 20 == 0) publisher->publish_local_map(at(900 + i), points);
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
  });
  std::set<std::string> submaps;
  double seconds = 0.0;
  while (const auto line = reader.line()) {
    if (!line->starts_with("cloud")) continue;
    CHECK(line->size() > 64 * points.size());
    if (line->starts_with("cloud 9")) continue;
    if (submaps.insert(line->substr(0, line->find(" map"))).second)
      seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  }
  INFO("from the match to the last kept submap: " << seconds << " s");
  CHECK(submaps.size() == 20);
  CHECK(reader.exit_status() == 0);
  CHECK(seconds < 10.0);
}
