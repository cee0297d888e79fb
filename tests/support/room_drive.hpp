#pragma once

#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/imu/decoder.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "tests/support/synthetic_room.hpp"
#include "tests/support/temporary_folder.hpp"

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <string>

namespace nilio::tests {

// 2026-01-01 12:00:00 UTC.
inline constexpr std::int64_t kDriveStartNs = 1'767'268'800'000'000'000;
inline constexpr double kRevolutionSeconds = 0.1;

/// One packet of a VLP-16 in the hall; every firing is cast from the pose of its own time.
inline drivers::VelodyneDataPacket room_packet(const Room& room, const PoseFunction& T_world_base,
                                               const drivers::VelodyneSensor& sensor,
                                               std::int64_t packet_ns) {
  drivers::VelodyneDataPacket packet;
  packet.timestamp_us = static_cast<std::uint32_t>((kDriveStartNs + packet_ns) / 1000 % 3'600'000'000);
  packet.factory_byte_1 = sensor.single().return_mode_byte;
  packet.factory_byte_2 = sensor.product_byte;
  const double step_deg =
      360.0 * static_cast<double>(sensor.single().azimuth_period_ns) * 1e-9 / kRevolutionSeconds;
  for (std::size_t b = 0; b < drivers::kBlocksPerPacket; ++b) {
    auto& block = packet.blocks[b];
    const double block_s =
        static_cast<double>(packet_ns + static_cast<std::int64_t>(b) * sensor.single().azimuth_period_ns) *
        1e-9;
    const double azimuth_deg = std::fmod(180.0 + 360.0 * block_s / kRevolutionSeconds, 360.0);
    block.azimuth = static_cast<std::uint16_t>(std::lround(azimuth_deg * 100.0) % drivers::kAzimuthModulus);
    for (std::size_t c = 0; c < drivers::kEntriesPerBlock; ++c) {
      const drivers::PacketEntry& entry = sensor.single().entries[b][c];
      const drivers::LaserCalibration& laser = sensor.lasers[entry.laser];
      const core::SE3 pose = T_world_base(static_cast<double>(packet_ns + entry.time_offset_ns) * 1e-9);
      const double azimuth = (block.azimuth * 0.01 + static_cast<double>(entry.azimuth_fraction) * step_deg) *
                             std::numbers::pi / 180.0;
      const core::Vector3 direction(std::cos(laser.elevation_rad) * std::cos(azimuth),
                                    -std::cos(laser.elevation_rad) * std::sin(azimuth),
                                    std::sin(laser.elevation_rad));
      const double range =
          room.cast(pose * core::Vector3(0.0, 0.0, laser.vertical_offset_m), pose.rotation * direction);
      block.entries[c].distance =
          static_cast<std::uint16_t>(std::min(65535.0, std::round(range / sensor.distance_resolution_m)));
      block.entries[c].intensity = 50;
    }
  }
  return packet;
}

/// Writes imu.log: frames of a preset at 200 Hz.
inline void write_imu_log(const std::filesystem::path& folder, const PoseFunction& T_world_base,
                          double seconds, const std::string& preset_name) {
  const core::Result<drivers::ImuPreset> preset = drivers::imu_preset(preset_name);
  std::ofstream log(folder / "imu.log");
  for (int i = 0; i * 0.005 < seconds + 0.05; ++i) {
    core::ImuSample sample = imu_sample(T_world_base, i * 0.005, core::Vector3(0.002, 0.001, 0.0035));
    sample.stamp = core::Time{kDriveStartNs + i * 5'000'000LL};
    for (const drivers::CanFrame& frame : drivers::encode_imu_sample(sample, *preset)) {
      log << drivers::format_candump_line(frame, "can0") << '\n';
    }
  }
}

/// Writes lidar.pcap and, if wanted, imu.log (Xsens frames at 200 Hz) of a drive through the room.
inline void write_room_drive(const std::filesystem::path& folder, const PoseFunction& T_world_base,
                             double seconds, bool with_imu) {
  const Room room = Room::with_pillars();
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  core::Result<drivers::PcapWriter> writer = drivers::PcapWriter::create((folder / "lidar.pcap").string());
  for (std::int64_t t = 0; static_cast<double>(t) * 1e-9 < seconds; t += sensor.single().packet_period_ns) {
    const auto bytes = drivers::encode(room_packet(room, T_world_base, sensor, t));
    writer->write(core::Time{kDriveStartNs + t + sensor.single().packet_period_ns + 100'000}, 2368, bytes);
  }
  writer->close();
  if (with_imu) write_imu_log(folder, T_world_base, seconds, "xsens_mti");
}

/// 8 m/s in bends as sharp as a town's, up to 23 deg/s, where a gyro beats a constant rate.
inline core::SE3 s_curve(double t) {
  const double yaw = 0.25 * std::sin(1.6 * t);
  const double lateral = 8.0 * 0.25 / 1.6 * (1.0 - std::cos(1.6 * t));
  return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw, core::Vector3::UnitZ())),
          core::Vector3(8.0 * t, lateral, 0.0)};
}

}  // namespace nilio::tests
