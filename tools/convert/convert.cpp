#include "tools/convert/convert.hpp"

#include "nilio/core/units.hpp"
#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/imu/decoder.hpp"

#include "tools/common/files.hpp"
#include "tools/common/progress.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/convert/kitti_raw.hpp"
#include "tools/convert/kitti_raw_encoder.hpp"
#include "tools/gnss/track.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <limits>
#include <string>
#include <vector>

namespace nilio::tools::convert {

namespace fs = std::filesystem;

namespace {

constexpr double kMaxMedianErrorM = 0.001;
// Margin of the inertial data before the first and after the last scan.
constexpr core::Duration kMargin{1'000'000'000};

struct LidarSummary {
  std::size_t points = 0;
  std::size_t encoded = 0;
  std::size_t collisions = 0;
  std::size_t out_of_range = 0;
  std::uint64_t packets = 0;
};

core::Error cannot_write(const fs::path& path) {
  return core::Error{path.string() + ": could not be written - check the folder and the space on the disk"};
}

core::Result<LidarSummary> write_lidar(const KittiRawDrive& drive, const drivers::VelodyneSensor& sensor,
                                       const fs::path& path) {
  auto writer = drivers::PcapWriter::create(path.string());
  if (!writer) return writer.error();
  HdlPacketStream stream(sensor, std::move(writer).value());
  LidarSummary summary;
  Progress progress("encoding scans", drive.scans.size());
  for (std::size_t i = 0; i < drive.scans.size(); ++i) {
    const KittiRawScan& scan = drive.scans[i];
    progress.update(i);
    const auto points = read_kitti_scan(scan.path);
    if (!points) return points.error();
    const auto encoded = encode_kitti_scan(*points, scan, sensor);
    if (!encoded) return encoded.error();
    summary.points += points->size();
    summary.encoded += encoded->encoded;
    summary.collisions += encoded->collisions;
    summary.out_of_range += encoded->out_of_range;
    for (const HdlColumn& column : encoded->columns) {
      if (!stream.add(column)) return cannot_write(path);
    }
  }
  if (!stream.finish()) return cannot_write(path);
  summary.packets = stream.packets();
  return summary;
}

std::vector<OxtsRecord> records_around_scans(const KittiRawDrive& drive) {
  const core::Time first = drive.scans.front().start - kMargin;
  const core::Time last = drive.scans.back().end + kMargin;
  std::vector<OxtsRecord> records;
  for (const OxtsRecord& record : drive.oxts) {
    if (record.stamp >= first && record.stamp <= last) records.push_back(record);
  }
  return records;
}

core::Result<std::size_t> write_imu(const std::vector<OxtsRecord>& records, const fs::path& path) {
  const auto preset = drivers::imu_preset("oxts_rt3003");
  if (!preset) return preset.error();
  std::ofstream file(path);
  for (const OxtsRecord& record : records) {
    const core::ImuSample sample{record.stamp, record.angular_velocity, record.linear_acceleration};
    for (const drivers::CanFrame& frame : drivers::encode_imu_sample(sample, *preset)) {
      file << drivers::format_candump_line(frame, "can0") << '\n';
    }
  }
  file.close();
  if (!file) return cannot_write(path);
  return records.size();
}

/// Positions of the inertial unit.
std::string gnss_text(const std::vector<OxtsRecord>& records, const fs::path& path) {
  gnss::Track track;
  track.name = path.string();
  for (const OxtsRecord& record : records) {
    gnss::Fix fix;
    fix.stamp = record.stamp;
    fix.latitude_deg = record.latitude_deg;
    fix.longitude_deg = record.longitude_deg;
    fix.altitude_m = record.altitude_m;
    const double deviation_m = record.position_deviation_m;
    fix.deviation_m = {deviation_m, deviation_m, std::numeric_limits<double>::quiet_NaN()};
    track.fixes.push_back(fix);
  }
  return gnss::csv_text(track);
}

/// `T_lidar_imu`: null without inertial data.
core::Result<std::size_t> write_configuration(const core::SE3* T_lidar_imu, const fs::path& path) {
  std::string text =
      "# Sensors of this recording, converted from a KITTI raw drive. base_link is the LiDAR.\n"
      "# Extrinsics are poses in base_link: metres; roll, pitch, yaw in degrees, R = Rz(yaw) Ry(pitch) "
      "Rx(roll).\n"
      "lidar:\n"
      "  model: HDL-64E-S2\n"
      "  elevation_correction_deg: 0.205  # bias of KITTI's scanner (IMLS-SLAM and others)\n"
      "  extrinsic:\n"
      "    translation: [0, 0, 0]\n"
      "    rotation_rpy_deg: [0, 0, 0]\n"
      "imu:\n";
  if (T_lidar_imu == nullptr) {
    text += "  enabled: false\n";
  } else {
    const Eigen::Matrix3d R = T_lidar_imu->rotation.toRotationMatrix();
    const double roll = kDegreesPerRadian * std::atan2(R(2, 1), R(2, 2));
    const double pitch = kDegreesPerRadian * std::atan2(-R(2, 0), std::hypot(R(2, 1), R(2, 2)));
    const double yaw = kDegreesPerRadian * std::atan2(R(1, 0), R(0, 0));
    const Eigen::Vector3d& t = T_lidar_imu->translation;
    std::array<char, 256> imu{};
    std::snprintf(imu.data(), imu.size(),
                  "  preset: oxts_rt3003\n"
                  "  extrinsic:\n"
                  "    translation: [%.7f, %.7f, %.7f]\n"
                  "    rotation_rpy_deg: [%.6f, %.6f, %.6f]\n",
                  t.x(), t.y(), t.z(), roll, pitch, yaw);
    text += imu.data();
  }
  std::ofstream file(path);
  file << text;
  file.close();
  if (!file) return cannot_write(path);
  return std::size_t{1};
}

void print_summary(const KittiRawDrive& drive, const LidarSummary& lidar,
                   const std::vector<OxtsRecord>& records, const fs::path& output) {
  std::cout << (output / "lidar.pcap").string() << ": " << drive.scans.size() << " scans (frames "
            << drive.scans.front().frame << " to " << drive.scans.back().frame << "), " << lidar.packets
            << " packets\n"
            << "  points: " << lidar.points << " read, " << lidar.encoded << " encoded, " << lidar.collisions
            << " left out because their laser has another point in the same azimuth column, "
            << lidar.out_of_range << " out of the packet's range\n";
  if (drive.scans_without_stamp > 0) {
    std::cout << "  " << drive.scans_without_stamp << " scans left out: no usable start and end time\n";
  }
  if (records.empty()) {
    std::cout << "no oxts/ in the drive: neither inertial data nor ground truth";
  } else {
    std::cout << (output / "imu.candump.log").string() << ": " << records.size() << " samples";
  }
  if (records.size() > 1) {
    const double span = (records.back().stamp - records.front().stamp).seconds();
    const double rate = static_cast<double>(records.size() - 1) / span;
    std::cout << " at " << std::round(rate * 10.0) / 10.0 << " Hz";
    if (rate < 50.0) std::cout << " (too slow for deskewing: give the _extract drive with --oxts for 100 Hz)";
  }
  std::cout << "\nTimes of the recording are read as UTC.\n";
}

/// 0, or 1 when the capture does not give the scans back.
int print_check(const ConversionCheck& check, const LidarSummary& lidar) {
  std::array<char, 256> text{};
  std::snprintf(text.data(), text.size(),
                "check: %llu points in, %llu points decoded from the capture; distance to the original: "
                "median %.2f mm, "
                "p99 %.2f mm, max %.2f mm\n",
                static_cast<unsigned long long>(check.original_points),
                static_cast<unsigned long long>(check.decoded_points), check.median_m * 1e3,
                check.p99_m * 1e3, check.max_m * 1e3);
  std::cout << text.data();
  if (check.decoded_points == lidar.encoded && check.unexplained_points == 0 &&
      check.median_m < kMaxMedianErrorM) {
    return 0;
  }
  std::cerr << "nilio convert: the capture does not reproduce the scans: " << lidar.encoded
            << " points were encoded, " << check.decoded_points << " came back, " << check.unexplained_points
            << " of them belong to no scan - do not use it\n";
  return 1;
}

}  // namespace

core::Result<int> convert_kitti_raw(const Options& options) {
  const auto drive =
      read_kitti_raw(options.drive, options.oxts_drive.empty() ? options.drive : options.oxts_drive);
  if (!drive) return drive.error();
  const std::vector<OxtsRecord> records = records_around_scans(*drive);
  if (records.empty() && !drive->oxts.empty()) {
    return core::Error{options.drive + ": no OXTS record has a time within the scans - check --oxts"};
  }
  const fs::path output = options.output;
  std::error_code error;
  fs::create_directories(output, error);
  if (error) return core::Error{output.string() + ": " + error.message()};
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kHdl64eS2);
  for (const char* name : {"imu.candump.log", "truth.tum", "gnss.csv"}) fs::remove(output / name, error);
  const UnfinishedFile capture(output / "lidar.pcap");
  const auto lidar = write_lidar(*drive, sensor, capture.path());
  if (!lidar) return lidar.error();
  if (!records.empty()) {
    const auto imu = write_imu(records, output / "imu.candump.log");
    if (!imu) return imu.error();
    const auto truth =
        write_trajectory(oxts_trajectory(records, drive->T_lidar_imu), (output / "truth.tum").string());
    if (!truth) return truth.error();
    const fs::path gnss = output / "gnss.csv";
    if (auto written = write_text(gnss, gnss_text(records, gnss)); !written) return written.error();
  }
  const auto configuration =
      write_configuration(records.empty() ? nullptr : &drive->T_lidar_imu, output / "nilio.yaml");
  if (!configuration) return configuration.error();
  if (auto finished = capture.finish(); !finished) return finished.error();
  print_summary(*drive, *lidar, records, output);
  const auto check = check_conversion((output / "lidar.pcap").string(), drive->scans, sensor);
  if (!check) return check.error();
  return print_check(*check, *lidar);
}

}  // namespace nilio::tools::convert
