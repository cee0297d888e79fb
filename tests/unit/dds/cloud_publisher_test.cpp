#include "ipc/dds/cloud_publisher.hpp"

#include "daemon/publisher/cloud_loop.hpp"
#include "tests/support/dds_support.hpp"

#include <chrono>
#include <cstring>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <catch2/catch.hpp>

namespace {

using namespace nilio;
using namespace nilio::tests;

constexpr std::size_t kPoints = 5;

// A quarter turn to the left about z, then a displacement: x y z becomes 10 - y, x - 20, z + 1.
std::unique_ptr<ipc::ScanCloud> sample_scan(std::uint64_t sequence) {
  auto scan = std::make_unique<ipc::ScanCloud>();
  scan->sequence = sequence;
  scan->stamp_ns = 1'700'000'000'000'000'003 + static_cast<std::int64_t>(sequence) * 100'000'000;
  scan->position = {10.0, -20.0, 1.0};
  scan->orientation_xyzw = {0.0, 0.0, std::sqrt(0.5), std::sqrt(0.5)};
  scan->count = kPoints;
  for (std::size_t i = 0; i < kPoints; ++i)
    scan->points[i] = {static_cast<float>(i), 2.0F, 3.0F, 10.0F * static_cast<float>(i)};
  return scan;
}

std::string hex_of(std::initializer_list<float> values) {
  std::string text;
  for (const float value : values) {
    std::array<std::uint8_t, 4> bytes{};
    std::memcpy(bytes.data(), &value, 4);
    std::array<char, 3> digits{};
    for (const std::uint8_t byte : bytes) {
      std::snprintf(digits.data(), digits.size(), "%02x", byte);
      text += digits.data();
    }
  }
  return text;
}

dds::CloudPublisherConfig config_for(std::uint32_t domain) { return {loopback(domain), "odom", ""}; }

std::unique_ptr<dds::CloudPublisher> make_cloud_publisher(std::uint32_t domain) {
  auto publisher = dds::CloudPublisher::create(config_for(domain));
  if (!publisher) FAIL(publisher.error().message);
  return std::move(publisher).value();
}

std::string reader_command(const std::filesystem::path& program, std::uint32_t domain) {
  return kCycloneLoopback + program.string() + " " + std::to_string(domain) + " 3 30 clouds";
}

}  // namespace

TEST_CASE("a registered scan is published in odom, thinned to the number of points", "[cloud_publisher]") {
  dds::PointCloud2 cloud;
  dds::set_fields(cloud, {"x", "y", "z", "intensity"});
  CHECK(cloud.point_step == 16);
  dds::fill_cloud(*sample_scan(4), 3, cloud);
  CHECK(cloud.stamp.ns == 1'700'000'000'400'000'003);
  CHECK(cloud.width == 3);
  CHECK(cloud.row_step == 48);
  REQUIRE(cloud.data.size() == 48);
  std::array<float, 12> values{};
  std::memcpy(values.data(), cloud.data.data(), 48);
  for (std::size_t i = 0; i < 3; ++i) {
    CHECK(values[4 * i] == Approx(8.0));
    CHECK(values[4 * i + 1] == Approx(-20.0 + static_cast<double>(i)));
    CHECK(values[4 * i + 2] == Approx(4.0));
    CHECK(values[4 * i + 3] == 10.0F * static_cast<float>(i));
  }
}

TEST_CASE("a count beyond the capacity is limited to it", "[cloud_publisher]") {
  const auto scan = sample_scan(0);
  scan->count = 1ULL << 40;
  dds::PointCloud2 cloud;
  dds::set_fields(cloud, {"x", "y", "z", "intensity"});
  dds::fill_cloud(*scan, 1ULL << 50, cloud);
  CHECK(cloud.width == ipc::ScanCloud::kCapacity);
}

TEST_CASE("CycloneDDS reads registered scans and the path from the IDL with equal fields",
          "[cloud_publisher]") {
  const auto program = built_program("nilio-cyclone-reader");
  if (!program) return;
  const std::uint32_t domain = test_domain();
  const auto publisher = make_cloud_publisher(domain);
  Program reader(reader_command(*program, domain));
  REQUIRE(
      eventually([&] { return publisher->scan_subscribers() == 2 && publisher->path_subscribers() == 1; }));
  REQUIRE(reader.line() == "ready");
  const auto scan = sample_scan(1);
  scan->orientation_xyzw = {0.0, 0.0, 0.0, 1.0};
  for (int i = 0; i < 3; ++i) {
    REQUIRE(publisher->publish_scan(*scan, 2));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  dds::Path path;
  path.stamp = {7'000'000'001};
  path.poses = {{{5'000'000'002}, "", {1.0, -2.0, 0.5}, {0.5, -0.5, 0.5, -0.5}},
                {{7'000'000'001}, "", {}, {}}};
  REQUIRE(publisher->publish_path(path));
  const std::string cloud_line =
      "cloud 1700000000 100000003 odom - 1 2 [x 0 7 1] [y 4 7 1] [z 8 7 1] [intensity 12 7 1] 0 16 32 1 " +
      hex_of({10.0F, -18.0F, 4.0F, 0.0F, 11.0F, -18.0F, 4.0F, 10.0F});
  int clouds = 0;
  int paths = 0;
  while (const auto line = reader.line()) {
    if (line->starts_with("cloud")) {
      CHECK(*line == cloud_line);
      ++clouds;
    } else if (line->starts_with("path")) {
      ++paths;
      CHECK(
          *line ==
          "path 7 1 odom - pose 5 2 odom - 0x1p+0 -0x1p+1 0x1p-1 0x1p-1 -0x1p-1 0x1p-1 -0x1p-1 pose 7 1 odom "
          "- 0x0p+0 0x0p+0 0x0p+0 0x0p+0 0x0p+0 0x0p+0 0x0p+0");
    }
  }
  CHECK(clouds == 6);
  CHECK(paths == 1);
  CHECK(reader.exit_status() == 0);
}

TEST_CASE(
    "scans are wanted and sent only while somebody subscribes, and a late subscriber gets the whole path",
    "[cloud_publisher]") {
  const auto program = built_program("nilio-cyclone-reader");
  if (!program) return;
  const std::uint32_t domain = test_domain();
  auto scans = ipc::OverwritingRing<ipc::ScanCloud>::in_shared_memory(4);
  auto path = ipc::OverwritingRing<ipc::PathPose>::in_shared_memory(64);
  auto wake = ipc::WakeEvent::create();
  REQUIRE((scans.ok() && path.ok() && wake.ok()));
  auto read_scans = ipc::OverwritingRing<ipc::ScanCloud>::attach(scans->file_descriptor());
  auto read_path = ipc::OverwritingRing<ipc::PathPose>::attach(path->file_descriptor());
  REQUIRE((read_scans.ok() && read_path.ok()));
  for (int i = 0; i < 10; ++i) path->push({i, {1.0 * i, 0.0, 0.0}, {0.0, 0.0, 0.0, 1.0}});
  dds::CloudLoop loop({std::move(read_scans).value(), std::move(read_path).value(), std::move(wake).value()},
                      [domain] { return make_cloud_publisher(domain); },
                      {.scan_rate_max_hz = 1000.0, .path_poses = 4});
  loop.start([] {});
  scans->push(*sample_scan(0), sample_scan(0)->bytes());
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  CHECK_FALSE(scans->wanted());
  CHECK(loop.counts().scans == 0);
  CHECK(loop.counts().paths == 0);
  {
    Program reader(reader_command(*program, domain));
    REQUIRE(eventually([&] { return scans->wanted(); }));
    REQUIRE(reader.line() == "ready");
    std::uint64_t sequence = 1;
    std::string path_line;
    while (true) {
      const auto scan = sample_scan(sequence++);
      scans->push(*scan, scan->bytes());
      path->push({1000, {50.0, 0.0, 0.0}, {0.0, 0.0, 0.0, 1.0}});
      const auto line = reader.line();
      if (!line) break;
      if (line->starts_with("path")) path_line = *line;
      if (sequence > 500) FAIL("the reader does not end");
    }
    // The newest four of all poses, those before the subscription included.
    CHECK(std::count(path_line.begin(), path_line.end(), 'e') >= 4);
    CHECK(loop.counts().scans >= 3);
    CHECK(loop.counts().failed_writes == 0);
  }
  CHECK(eventually([&] { return !scans->wanted(); }));
  loop.stop();
}

TEST_CASE("a rate limit keeps the average of jittering stamps and survives a clock that goes back",
          "[cloud_publisher]") {
  dds::RateLimit ten(10.0);
  int passed = 0;
  for (int i = 0; i < 1000; ++i) passed += ten.passes({i * 99'700'000LL + (i % 3) * 2'000'000}) ? 1 : 0;
  CHECK(passed >= 995);
  CHECK(passed <= 999);
  passed = 0;
  for (int i = 0; i < 1000; ++i) passed += ten.passes({i * 50'000'000LL}) ? 1 : 0;
  CHECK(passed >= 500);
  CHECK(passed <= 501);
  dds::RateLimit slow(0.1);
  CHECK(slow.passes({1'000'000'000'000}));
  CHECK_FALSE(slow.passes({1'000'000'000'001}));
  CHECK(slow.passes({5}));
}
