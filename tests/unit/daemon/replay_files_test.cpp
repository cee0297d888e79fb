#include "daemon/input/input.hpp"
#include "tests/support/hdl64e_packets.hpp"
#include "tests/support/room_drive.hpp"

#include <array>
#include <cmath>
#include <map>
#include <span>
#include <string>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using Catch::Matchers::Contains;
using tests::TemporaryFolder;

namespace {

namespace fs = std::filesystem;

void touch(const fs::path& path) { std::ofstream(path) << "x"; }

std::vector<std::string> names(const std::vector<std::string>& paths) {
  std::vector<std::string> result;
  for (const std::string& path : paths) result.push_back(fs::path(path).filename().string());
  return result;
}

}  // namespace

TEST_CASE("numbered files of a recording are its parts in numerical order", "[replay_files]") {
  const TemporaryFolder folder;
  for (const char* name :
       {"lidar_9998.pcap", "lidar_10000.pcap", "lidar_9999.pcap", "can_10000.log", "can_9999.log"})
    touch(folder.path() / name);
  const auto files = find_replay_files({folder.path().string()});
  REQUIRE(files.ok());
  CHECK(names(files->captures) ==
        std::vector<std::string>{"lidar_9998.pcap", "lidar_9999.pcap", "lidar_10000.pcap"});
  CHECK(names(files->can_logs) == std::vector<std::string>{"can_9999.log", "can_10000.log"});
}

TEST_CASE("captures of different recordings are rejected with both names", "[replay_files]") {
  const TemporaryFolder folder;
  const TemporaryFolder other;
  const auto expect_refused = [](const std::vector<std::string>& paths) {
    const auto files = find_replay_files(paths);
    REQUIRE_FALSE(files.ok());
    CHECK_THAT(files.error().message, Contains("a second capture beside"));
  };
  touch(folder.path() / "lidar_0001.pcap");
  touch(other.path() / "lidar_0002.pcap");
  expect_refused({folder.path().string(), other.path().string()});
  const std::string twice = (folder.path() / "lidar_0001.pcap").string();
  expect_refused({twice, twice});
  touch(folder.path() / "drive.pcap");
  expect_refused({folder.path().string()});
}

TEST_CASE("CAN logs without a capture can be played but not replayed", "[replay_files]") {
  const TemporaryFolder folder;
  touch(folder.path() / "can_0001.log");
  CHECK(sort_replay_files({folder.path().string()}).ok());
  CHECK_FALSE(find_replay_files({folder.path().string()}).ok());
}

TEST_CASE("captures and CAN logs of a replay are recognised by their content", "[replay_files]") {
  const TemporaryFolder folder;
  tests::write_room_drive(folder.path(), tests::s_curve, 0.3, true);
  fs::rename(folder.path() / "lidar.pcap", folder.path() / "drive.dat");
  fs::rename(folder.path() / "imu.log", folder.path() / "bus.txt");
  REQUIRE_FALSE(folder.write("niliod.log", "not a frame\n").empty());
  const auto files = find_replay_files({folder.text()});
  REQUIRE(files.ok());
  CHECK(names(files->captures) == std::vector<std::string>{"drive.dat"});
  CHECK(names(files->can_logs) == std::vector<std::string>{"bus.txt"});
  const auto other = find_replay_files({folder.write("drive.gz", "\x1F\x8B...")});
  REQUIRE_FALSE(other.ok());
  CHECK_THAT(other.error().message, Contains("drive.gz: is compressed (gzip)"));
}

TEST_CASE("folders of point clouds without times are refused with the way to convert them",
          "[replay_files]") {
  const auto message_of = [](const TemporaryFolder& folder) {
    const auto files = find_replay_files({folder.text()});
    REQUIRE_FALSE(files.ok());
    return files.error().message;
  };
  const TemporaryFolder raw;
  REQUIRE_FALSE(raw.write("velodyne_points/data/0000000000.bin", "1234").empty());
  CHECK_THAT(message_of(raw), Contains("nilio convert kitti-raw"));
  for (const char* const name : {"lidar/1630597205.bin", "000000.bin", "clouds/000.pcd", "a.ply"}) {
    CAPTURE(name);
    const TemporaryFolder folder;
    REQUIRE_FALSE(folder.write(name, "x").empty());
    CHECK_THAT(message_of(folder), Contains(name) && Contains("PointCloud2") && Contains("times.txt"));
  }
  const TemporaryFolder run;
  REQUIRE_FALSE(run.write("map.ply", "ply\n").empty());
  CHECK_THAT(message_of(run), Contains("nothing to replay"));
  const auto file = find_replay_files({raw.file("velodyne_points/data/0000000000.bin")});
  REQUIRE_FALSE(file.ok());
  CHECK_THAT(file.error().message, Contains("single point cloud"));
}

TEST_CASE("an unfinished recording is not replayed and is named", "[replay_files]") {
  const TemporaryFolder folder;
  tests::write_room_drive(folder.path(), tests::s_curve, 0.3, true);
  fs::rename(folder.path() / "lidar.pcap", folder.path() / "lidar.pcap.partial");
  const auto files = find_replay_files({folder.text()});
  REQUIRE_FALSE(files.ok());
  CHECK_THAT(files.error().message, Contains("lidar.pcap.partial: is unfinished"));
}

TEST_CASE("a missing part of a recording causes a warning", "[replay_files]") {
  const TemporaryFolder folder;
  tests::write_room_drive(folder.path(), tests::s_curve, 0.3, false);
  fs::copy_file(folder.path() / "lidar.pcap", folder.path() / "lidar_0003.pcap");
  fs::rename(folder.path() / "lidar.pcap", folder.path() / "lidar_0001.pcap");
  const auto files = find_replay_files({folder.path().string()});
  REQUIRE(files.ok());
  const auto input = open_replay(*files, Config{});
  REQUIRE(input.ok());
  REQUIRE(!input->warnings.empty());
  CHECK_THAT(input->warnings.front(), Contains("lidar_0001.pcap: 1 parts of the recording are missing"));
}

TEST_CASE("a replay reads the calibration transmitted by an HDL-64E ahead and starts from the first packet",
          "[replay_files]") {
  const TemporaryFolder folder;
  const std::string path = (folder.path() / "lidar.pcap").string();
  auto writer = drivers::PcapWriter::create(path);
  REQUIRE(writer.ok());
  const std::vector<drivers::Packet> packets =
      tests::hdl64e_packets(2 * drivers::kHdl64eStatusPackets, tests::StatusStream::kWhole, 100);
  for (const drivers::Packet& packet : packets)
    REQUIRE(writer->write(packet.stamp, 2368, std::span(packet.data).first(packet.size)));
  REQUIRE(writer->close());
  const auto files = find_replay_files({path});
  REQUIRE(files.ok());
  const auto input = open_replay(*files, Config{});
  REQUIRE(input.ok());
  REQUIRE(input->sensor.has_value());
  CHECK(input->sensor->lasers[9].elevation_rad == tests::make_writer().calibration().lasers[9].elevation_rad);
  CHECK_THAT(input->notes.front(), Contains("HDL-64E-S2") && Contains("its own status stream"));
  std::vector<drivers::Packet> slots(1);
  REQUIRE(input->packets->read(slots, {}).count == 1);
  CHECK(slots[0].stamp == packets[0].stamp);
  CHECK(input->first_stamp == packets[0].stamp);
}

TEST_CASE("a damaged KITTI scan is delivered as an empty scan with a warning that names the file",
          "[replay_files]") {
  const TemporaryFolder folder;
  const std::string whole(160, '\x3F');
  const std::map<std::string, std::string> content{{"velodyne/000000.bin", whole},
                                                   {"velodyne/000001.bin", whole.substr(0, 150)},
                                                   {"velodyne/000002.bin", whole},
                                                   {"times.txt", "0.0\n0.1\n0.2\n"},
                                                   {"calib.txt", "Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n"}};
  for (const auto& [name, bytes] : content) REQUIRE_FALSE(folder.write(name, bytes).empty());
  const auto files = find_replay_files({folder.text()});
  REQUIRE(files.ok());
  auto input = open_replay(*files, Config{});
  REQUIRE(input.ok());
  REQUIRE(input->warnings.size() == 1);
  CHECK_THAT(input->warnings.front(), Contains("000001.bin"));
  core::Scan scan;
  for (const std::size_t points : {10U, 0U, 10U}) {
    REQUIRE(input->scans->next(scan, core::Duration{}) == FeedState::kScan);
    CHECK(scan.points.size() == points);
  }
  CHECK(input->scans->next(scan, core::Duration{}) == FeedState::kEnd);
  CHECK(input->scans->stats().partial_scans == 1);
}

TEST_CASE("points of a KITTI scan have the number of their beam if all beams are there", "[replay_files]") {
  // Ring after ring, the highest first, each counterclockwise from straight ahead; rings lack returns.
  const auto scan_with = [](int rings) {
    std::string bytes;
    for (int ring = 0; ring < rings; ++ring) {
      for (int column = ring % 3; column < 40; column += 1 + ring % 2) {
        const double azimuth = 2.0 * M_PI * (column + 0.5) / 40.0;
        const std::array<float, 4> point{static_cast<float>(20.0 * std::cos(azimuth)),
                                         static_cast<float>(20.0 * std::sin(azimuth)),
                                         2.0F - 0.1F * static_cast<float>(ring), 0.3F};
        bytes.append(reinterpret_cast<const char*>(point.data()), sizeof(point));
      }
    }
    return bytes;
  };
  const TemporaryFolder folder;
  REQUIRE_FALSE(folder.write("velodyne/000000.bin", scan_with(64)).empty());
  REQUIRE_FALSE(folder.write("velodyne/000001.bin", scan_with(63)).empty());
  REQUIRE_FALSE(folder.write("times.txt", "0.0\n0.1\n").empty());
  REQUIRE_FALSE(folder.write("calib.txt", "Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n").empty());
  const auto files = find_replay_files({folder.text()});
  REQUIRE(files.ok());
  auto input = open_replay(*files, Config{});
  REQUIRE(input.ok());
  core::Scan scan;
  REQUIRE(input->scans->next(scan, core::Duration{}) == FeedState::kScan);
  for (const core::Point& point : scan.points)
    REQUIRE(static_cast<int>(point.ring) == 63 - static_cast<int>(std::lround((2.0F - point.z) * 10.0F)));
  REQUIRE(input->scans->next(scan, core::Duration{}) == FeedState::kScan);
  REQUIRE_FALSE(scan.points.empty());
  for (const core::Point& point : scan.points) REQUIRE(point.ring == 0);
}
