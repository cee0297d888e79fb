#include "tools/convert/convert.hpp"

#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/imu/decoder.hpp"

#include "tests/support/paths.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/tools/run_command.hpp"
#include "tools/commands/commands.hpp"
#include "tools/convert/kitti_raw.hpp"
#include "tools/convert/kitti_raw_encoder.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>

namespace fs = std::filesystem;
using nilio::core::Time;
using nilio::tests::run_command;
using nilio::tests::TemporaryFolder;
using namespace nilio::tools;
using namespace nilio::tools::convert;

namespace {

const std::string kDrive = "2011_09_26/2011_09_26_drive_0009_sync";

/// Scans 0, 1 and 3 (2 is missing), all stamps, OXTS and calibration.
void unpack_three_scans(const fs::path& archive, const TemporaryFolder& folder) {
  const std::string scans = kDrive + "/velodyne_points/";
  REQUIRE(nilio::tests::run_program("tar -xJf '" + archive.string() + "' -C '" + folder.file("") +
                                    "' --wildcards '*/calib_imu_to_velo.txt' '*/oxts/*' '*/timestamps*.txt' "
                                    "'*/velodyne_points/data/000000000[013].bin'")
              .second);
  REQUIRE(fs::exists(folder.file(scans + "data/0000000003.bin")));
}

std::string scan_bytes(const std::vector<KittiPoint>& points) {
  return {reinterpret_cast<const char*>(points.data()), points.size() * sizeof(KittiPoint)};
}

/// Checks that every sample of the log is one OXTS record to the resolution of its CAN signals; returns their
/// number.
std::size_t check_inertial_log(const std::string& path, const KittiRawDrive& drive) {
  const auto preset = nilio::drivers::imu_preset("oxts_rt3003");
  REQUIRE(preset);
  auto decoder = nilio::drivers::ImuDecoder::create(preset->mapping, preset->database);
  REQUIRE(decoder);
  std::ifstream log(path);
  std::string line;
  std::size_t samples = 0;
  while (std::getline(log, line)) {
    const auto parsed = nilio::drivers::parse_candump_line(line);
    REQUIRE(parsed);
    const auto sample = decoder->add(parsed->frame);
    if (!sample) continue;
    const auto record = std::find_if(drive.oxts.begin(), drive.oxts.end(),
                                     [&](const OxtsRecord& r) { return r.stamp == sample->stamp; });
    REQUIRE(record != drive.oxts.end());
    for (std::size_t axis = 0; axis < 3; ++axis) {
      CHECK(std::abs(sample->linear_acceleration[axis] - record->linear_acceleration[axis]) < 0.0051);
      CHECK(std::abs(sample->angular_velocity[axis] - record->angular_velocity[axis]) <
            0.0051 * M_PI / 180.0);
    }
    ++samples;
  }
  return samples;
}

}  // namespace

TEST_CASE("KITTI times are parsed to the nanosecond and malformed ones are rejected", "[convert]") {
  REQUIRE(parse_kitti_stamp("2011-09-26 13:08:24.957314930"));
  CHECK(parse_kitti_stamp("2011-09-26 13:08:24.957314930")->ns == 1317042504957314930);
  CHECK(parse_kitti_stamp("1970-01-01 00:00:01")->ns == 1'000'000'000);
  CHECK(parse_kitti_stamp("1970-01-01 00:00:00.5\r")->ns == 500'000'000);
  for (const char* bad : {"", "2011-09-26", "2011-13-26 13:08:24.9", "2011-02-30 13:08:24.9",
                          "2011-09-26 25:08:24.9", "2011-09-26 13:08:24.", "2011-09-26 13:08:24.0123456789",
                          "2011-09-26 13:08:2x.9", "2011-09-26T13:08:24.9", "-011-09-26 13:08:24.9"}) {
    CAPTURE(bad);
    CHECK_FALSE(parse_kitti_stamp(bad));
  }
}

TEST_CASE("a blank line in a stamp file is a lost scan, not the end of the file", "[convert]") {
  const TemporaryFolder folder;
  const auto stamps =
      read_kitti_stamps(folder.write("t.txt", "2011-09-26 13:08:24.0\n\n  \n2011-09-26 13:08:25.0\n"));
  REQUIRE(stamps);
  REQUIRE(stamps->size() == 4);
  CHECK((*stamps)[0]);
  CHECK_FALSE((*stamps)[1]);
  CHECK_FALSE((*stamps)[2]);
  CHECK((*stamps)[3]);
  const auto bad = read_kitti_stamps(folder.write("bad.txt", "2011-09-26 13:08:24.0\nnonsense\n"));
  REQUIRE_FALSE(bad);
  CHECK(bad.error().message.find("bad.txt:2") != std::string::npos);
}

TEST_CASE("truncated scan files and values that are not finite are rejected", "[convert]") {
  const TemporaryFolder folder;
  CHECK_FALSE(read_kitti_scan(folder.write("empty.bin", "")));
  CHECK_FALSE(read_kitti_scan(folder.write("cut.bin", std::string(17, 'x'))));
  CHECK_FALSE(read_kitti_scan(folder.file("missing.bin")));
  const auto bad = read_kitti_scan(folder.write("nan.bin", scan_bytes({{1, 2, 3, 0}, {1, NAN, 3, 0}})));
  REQUIRE_FALSE(bad);
  CHECK(bad.error().message.find("point 1") != std::string::npos);
}

TEST_CASE("rings are separated at yaw zero, where the last point of a ring may be rounded to minus zero",
          "[convert]") {
  const std::vector<KittiPoint> points{{10.0F, 0.1F, 0, 0},  {-10.0F, 0.1F, 0, 0}, {-10.0F, -0.1F, 0, 0},
                                       {10.0F, -0.0F, 0, 0}, {10.0F, 0.0F, 0, 0},  {10.0F, 5.0F, 0, 0}};
  CHECK(kitti_rings(points) == std::vector<std::uint16_t>{0, 0, 0, 0, 1, 1});
}

TEST_CASE("clouds that are not raw HDL-64E scans are rejected", "[convert]") {
  const auto sensor = nilio::drivers::make_velodyne_sensor(nilio::drivers::VelodyneModel::kHdl64eS2);
  const KittiRawScan scan{0, "scan.bin", Time{0}, Time{103'000'000}};
  CHECK_FALSE(encode_kitti_scan({}, scan, sensor));
  std::vector<KittiPoint> sphere;
  for (int i = 0; i < 10000; ++i) {
    const float yaw = 0.1F * static_cast<float>(i);
    sphere.push_back({10.0F * std::cos(yaw), 10.0F * std::sin(yaw), static_cast<float>(i % 7), 0.5F});
  }
  const auto encoded = encode_kitti_scan(sphere, scan, sensor);
  REQUIRE_FALSE(encoded);
  CHECK(encoded.error().message.find("scan.bin") != std::string::npos);
}

TEST_CASE("motion-compensated scans of the odometry benchmark are rejected", "[convert]") {
  NILIO_REQUIRE_DATA(archive, "kitti/odometry_04_frames_000-050.tar.xz");
  const TemporaryFolder folder;
  REQUIRE(nilio::tests::run_program("tar -xJf '" + archive.string() + "' -C '" + folder.file("") +
                                    "' --wildcards '*velodyne/000010.bin'")
              .second);
  std::string path;
  for (const auto& entry : fs::recursive_directory_iterator(folder.file(""))) {
    if (entry.path().extension() == ".bin") path = entry.path().string();
  }
  const auto points = read_kitti_scan(path);
  REQUIRE(points);
  const auto sensor = nilio::drivers::make_velodyne_sensor(nilio::drivers::VelodyneModel::kHdl64eS2);
  const auto encoded = encode_kitti_scan(*points, {10, path, Time{0}, Time{103'000'000}}, sensor);
  REQUIRE_FALSE(encoded);
  CHECK(encoded.error().message.find("motion-compensated") != std::string::npos);
}

TEST_CASE("a real drive converts to a recording with the same points, inertial data and path", "[convert]") {
  NILIO_REQUIRE_DATA(archive, "kitti/raw_2011_09_26_drive_0009_scans_00-50.tar.xz");
  const TemporaryFolder folder;
  unpack_three_scans(archive, folder);
  const std::string output = folder.file("out");
  REQUIRE(run_command(add_convert_command, {"convert", "kitti-raw", folder.file(kDrive), output}) == 0);

  const auto drive = read_kitti_raw(folder.file(kDrive), folder.file(kDrive));
  REQUIRE(drive);
  REQUIRE(drive->scans.size() == 3);
  CHECK(drive->scans[2].frame == 3);
  const auto sensor = nilio::drivers::make_velodyne_sensor(nilio::drivers::VelodyneModel::kHdl64eS2);
  const auto check = check_conversion(output + "/lidar.pcap", drive->scans, sensor);
  REQUIRE(check);
  CHECK(check->original_points > 350'000);
  CHECK(check->decoded_points == check->original_points);
  CHECK(check->unexplained_points == 0);
  CHECK(check->median_m < 0.0006);
  CHECK(check->p99_m < 0.001);
  CHECK(check->max_m < 0.002);

  CHECK(check_inertial_log(output + "/imu.candump.log", *drive) == 13);

  const auto truth = read_trajectory(output + "/truth.tum");
  REQUIRE(truth);
  CHECK(truth->poses.front().isApprox(Pose::Identity(), 1e-8));
  // 10.7 m/s straight ahead, for the 1.5 s around the scans.
  CHECK(path_length(truth->poses) ==
        Approx(10.7 * (truth->stamps.back() - truth->stamps.front()).seconds()).epsilon(0.05));
  CHECK(truth->poses.back().translation().x() > 10.0);
}

TEST_CASE("columns without returns keep their time", "[convert]") {
  NILIO_REQUIRE_DATA(archive, "kitti/raw_2011_09_26_drive_0009_scans_00-50.tar.xz");
  const TemporaryFolder folder;
  unpack_three_scans(archive, folder);
  const auto drive = read_kitti_raw(folder.file(kDrive), folder.file(kDrive));
  REQUIRE(drive);
  const auto points = read_kitti_scan(drive->scans[0].path);
  REQUIRE(points);
  const auto sensor = nilio::drivers::make_velodyne_sensor(nilio::drivers::VelodyneModel::kHdl64eS2);
  const auto whole = encode_kitti_scan(*points, drive->scans[0], sensor);
  // No points in front and on the whole ring 20, as with sky and a dead laser.
  std::vector<KittiPoint> rest;
  const auto rings = kitti_rings(*points);
  for (std::size_t i = 0; i < points->size(); ++i) {
    const KittiPoint& p = (*points)[i];
    if (std::abs(std::atan2(p.y, p.x)) > 0.5F && rings[i] != 20) rest.push_back(p);
  }
  const auto reduced = encode_kitti_scan(rest, drive->scans[0], sensor);
  REQUIRE(whole);
  REQUIRE(reduced);
  CHECK(whole->columns.size() == 2155);
  CHECK(std::abs(static_cast<int>(reduced->columns.size()) - static_cast<int>(whole->columns.size())) <= 3);
  CHECK(reduced->encoded == rest.size());
  const auto time_at = [](const EncodedScan& scan, int azimuth) {
    const auto column = std::find_if(scan.columns.begin(), scan.columns.end(), [azimuth](const HdlColumn& c) {
      return std::abs(c.azimuth_centidegrees - azimuth) <= 9;
    });
    REQUIRE(column != scan.columns.end());
    return column->stamp;
  };
  CHECK(std::abs((time_at(*whole, 9000) - time_at(*reduced, 9000)).ns) < 200'000);
}

TEST_CASE("a drive with missing files is rejected with the file's name", "[convert]") {
  const TemporaryFolder folder;
  CHECK(run_command(add_convert_command,
                    {"convert", "kitti-raw", folder.file("nothing"), folder.file("out")}) == 1);
  const std::string points = scan_bytes({{10, 0, 0, 0.5F}});
  const std::string drive = folder.file("date/drive_sync");
  REQUIRE_FALSE(folder.write("date/drive_sync/velodyne_points/data/0000000000.bin", points).empty());
  const auto without_stamps = read_kitti_raw(drive, drive);
  REQUIRE_FALSE(without_stamps);
  CHECK(without_stamps.error().message.find("timestamps_start.txt") != std::string::npos);
  REQUIRE_FALSE(folder.write("date/drive_sync/velodyne_points/timestamps_start.txt", "\n").empty());
  REQUIRE_FALSE(folder.write("date/drive_sync/velodyne_points/timestamps_end.txt", "\n").empty());
  const auto without_scan = read_kitti_raw(drive, drive);
  REQUIRE_FALSE(without_scan);
  CHECK(without_scan.error().message.find("no scan has a usable") != std::string::npos);
}

TEST_CASE("trailing points at the origin are not part of a scan", "[convert]") {
  const TemporaryFolder folder;
  const auto points =
      read_kitti_scan(folder.write("scan.bin", scan_bytes({{0, 0, 0, 0}, {1, 2, 3, 0.5F}, {0, 0, 0, 0}})));
  REQUIRE(points);
  CHECK(points->size() == 2);
}

TEST_CASE("a drive without oxts/ is converted without inertial data and ground truth", "[convert]") {
  NILIO_REQUIRE_DATA(archive, "kitti/raw_2011_09_26_drive_0009_scans_00-50.tar.xz");
  const TemporaryFolder folder;
  unpack_three_scans(archive, folder);
  const fs::path drive = folder.file(kDrive);
  fs::remove_all(drive / "oxts");
  const std::string scan = drive / "velodyne_points/data/0000000003.bin";
  std::ofstream(scan, std::ios::binary | std::ios::app) << scan_bytes({{0, 0, 0, 0}});
  const fs::path output = folder.file("out");
  REQUIRE(run_command(add_convert_command, {"convert", "kitti-raw", drive.string(), output.string()}) == 0);
  CHECK(fs::exists(output / "lidar.pcap"));
  CHECK_FALSE(fs::exists(output / "imu.candump.log"));
  CHECK_FALSE(fs::exists(output / "truth.tum"));
  std::ifstream configuration(output / "nilio.yaml");
  const std::string text{std::istreambuf_iterator<char>(configuration), {}};
  CHECK(text.find("enabled: false") != std::string::npos);
}
