#include "tools/bench/common/sensor_drive.hpp"

#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include "daemon/input/input.hpp"
#include "tools/common/files.hpp"

#include <algorithm>
#include <fstream>
#include <span>
#include <utility>
#include <vector>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

constexpr std::size_t kSlots = 64;

Result<std::unique_ptr<drivers::PacketSource>> open_packets(const SensorDrive& drive) {
  drivers::PcapSourceConfig config;
  config.data_port = static_cast<std::uint16_t>(drive.config.lidar.port);
  config.position_port = static_cast<std::uint16_t>(drive.config.lidar.position_port);
  config.sender_address = drive.config.lidar.sender_address;
  return drivers::chain_captures(drive.files.captures, config);
}

/// Writes the packets. Returns the end of the part.
Result<core::Time> write_packets(const SensorDrive& drive, core::Duration length, const fs::path& path,
                                 DrivePart& part) {
  auto source = open_packets(drive);
  if (!source) return source.error();
  std::ofstream file(path, std::ios::binary);
  std::vector<std::uint8_t> bytes;
  drivers::append_pcap_header(bytes);
  std::vector<drivers::Packet> slots(kSlots);
  std::optional<core::Time> end;
  for (bool going = true; going;) {
    const drivers::SourceRead read = (*source)->read(slots, core::Duration{});
    if (read.state != drivers::SourceState::kData) break;
    if (!end) {
      part.first_stamp = slots.front().stamp;
      end = part.first_stamp + length;
    }
    for (std::size_t i = 0; i < read.count && going; ++i) {
      going = slots[i].stamp < *end;
      if (!going || !drivers::append_pcap_record(bytes, slots[i])) continue;
      ++part.packets;
      part.length = slots[i].stamp - part.first_stamp;
    }
    file.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    bytes.clear();
  }
  if (!end) return Error{(*source)->status()};
  if (!file.flush()) return cannot_write(path);
  return *end;
}

Result<std::monostate> write_frames(const SensorDrive& drive, core::Time end, const fs::path& path) {
  auto source = drivers::chain_can_logs(drive.files.can_logs, drive.config.imu.interface_name);
  if (!source) return source.error();
  const std::string name = drive.config.imu.interface_name.empty() ? "can0" : drive.config.imu.interface_name;
  std::ofstream file(path);
  std::vector<drivers::CanFrame> slots(kSlots);
  for (bool going = true; going;) {
    const drivers::SourceRead read = (*source)->read(slots, core::Duration{});
    if (read.state != drivers::SourceState::kData) break;
    for (std::size_t i = 0; i < read.count && going; ++i) {
      going = slots[i].stamp < end;
      if (going) file << drivers::format_candump_line(slots[i], name) << '\n';
    }
  }
  if (!file.flush()) return cannot_write(path);
  return std::monostate{};
}

}  // namespace

Result<SensorDrive> open_sensor_drive(const std::string& argument) {
  SensorDrive drive;
  std::string path = argument;
  std::string truth;
  if (const std::size_t colon = argument.rfind(':'); colon != std::string::npos && !fs::exists(argument)) {
    path = argument.substr(0, colon);
    truth = argument.substr(colon + 1);
  } else if (fs::exists(fs::path(argument) / "truth.tum")) {
    truth = (fs::path(argument) / "truth.tum").string();
  }
  fs::path folder(path);
  if (folder.filename().empty()) folder = folder.parent_path();
  drive.name = folder.filename().string();
  Result<daemon::ReplayFiles> files = daemon::find_replay_files({path});
  if (!files) return files.error();
  drive.files = std::move(files).value();
  if (drive.files.captures.empty())
    return Error{
        path +
        ": has no packets to send - make packets of KITTI's raw drives with 'nilio convert kitti-raw'"};
  Result<daemon::Config> config = daemon::replay_config(drive.files, "");
  if (!config) return config.error();
  drive.config = std::move(config).value();
  const auto& more = drive.config.more_lidars;
  if (std::any_of(more.begin(), more.end(), [](const auto& lidar) { return lidar.enabled; }))
    return Error{
        path +
        ": has several LiDARs, and only one can be sent - set lidar2.enabled and the like to false in "
        "its nilio.yaml"};
  if (truth.empty()) return drive;
  Result<Trajectory> trajectory = read_trajectory(truth);
  if (!trajectory) return trajectory.error();
  drive.truth = std::move(trajectory).value();
  return drive;
}

Result<std::vector<SensorDrive>> open_sensor_drives(const std::vector<std::string>& arguments) {
  std::vector<SensorDrive> drives;
  for (const std::string& argument : arguments) {
    Result<SensorDrive> drive = open_sensor_drive(argument);
    if (!drive) return drive.error();
    drives.push_back(std::move(drive).value());
  }
  return drives;
}

Result<DrivePart> write_beginning(const SensorDrive& drive, core::Duration length, const fs::path& folder) {
  DrivePart part;
  const fs::path capture = folder / "lidar.pcap";
  const Result<core::Time> end = write_packets(drive, length, capture, part);
  if (!end) return end.error();
  part.files.captures = {capture.string()};
  part.files.configuration = drive.files.configuration;
  if (drive.files.can_logs.empty()) return part;
  const fs::path log = folder / "imu.candump.log";
  const auto written = write_frames(drive, *end, log);
  if (!written) return written.error();
  part.files.can_logs = {log.string()};
  return part;
}

}  // namespace nilio::tools::bench
