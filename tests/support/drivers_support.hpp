#pragma once

#include "nilio/drivers/velodyne/decoder.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <unistd.h>
#include <vector>

namespace nilio::tests {

/// 2023-11-14 22:13:20 UTC: 800 s past the hour.
inline constexpr std::int64_t kEpochNs = 1'700'000'000'000'000'000;

/// A file that the destructor removes.
class TemporaryFile {
 public:
  explicit TemporaryFile(std::string_view content, const std::string& suffix = ".tmp") {
    static int counter = 0;
    path_ = std::filesystem::temp_directory_path() /
            ("nilio_test_" + std::to_string(getpid()) + "_" + std::to_string(counter++) + suffix);
    std::ofstream(path_, std::ios::binary) << content;
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  ~TemporaryFile() {
    std::error_code ignored;
    std::filesystem::remove(path_, ignored);
  }
  [[nodiscard]] std::string path() const { return path_.string(); }

 private:
  std::filesystem::path path_;
};

/// A sensor turning evenly at `revolutions_per_second`, with a return for each beam; the distance identifies
/// the firing.
struct TurningSensor {
  drivers::VelodyneSensor sensor;
  double revolutions_per_second = 10.0;
  double start_azimuth_deg = 0.0;
  std::int64_t start_ns = kEpochNs;
  /// Sensor clock minus host clock.
  std::int64_t sensor_ahead_ns = 0;
  drivers::ReturnMode mode = drivers::ReturnMode::kSingle;

  [[nodiscard]] const drivers::PacketLayout& layout() const { return *sensor.layout(mode); }

  [[nodiscard]] std::uint16_t azimuth(std::size_t packet, std::size_t step) const {
    const auto steps =
        static_cast<double>(packet * drivers::kBlocksPerPacket / layout().blocks_per_azimuth + step);
    const double turns =
        steps * static_cast<double>(layout().azimuth_period_ns) * 1e-9 * revolutions_per_second;
    return static_cast<std::uint16_t>(std::llround(start_azimuth_deg * 100.0 + turns * 36000.0) % 36000);
  }

  [[nodiscard]] std::int64_t packet_time_ns(std::size_t packet) const {
    return start_ns + static_cast<std::int64_t>(packet) * layout().packet_period_ns;
  }

  /// Unique per firing of entry 0 within some seconds, 20 m to 100 m.
  [[nodiscard]] static std::uint16_t distance(std::size_t packet, std::size_t block) {
    return static_cast<std::uint16_t>(10000 + (packet * drivers::kBlocksPerPacket + block) % 40000);
  }

  [[nodiscard]] drivers::VelodyneDataPacket data(std::size_t packet) const {
    drivers::VelodyneDataPacket data;
    for (std::size_t b = 0; b < drivers::kBlocksPerPacket; ++b) {
      data.blocks[b].flag = layout().block_flags[b];
      data.blocks[b].azimuth = azimuth(packet, b / layout().blocks_per_azimuth);
      // Both returns of a dual packet are equal.
      const std::size_t block =
          mode == drivers::ReturnMode::kSingle ? b : b - b % layout().blocks_per_azimuth;
      for (auto& entry : data.blocks[b].entries) entry = {distance(packet, block), 7};
    }
    const std::int64_t sensor_ns = packet_time_ns(packet) + sensor_ahead_ns;
    data.timestamp_us = static_cast<std::uint32_t>(sensor_ns / 1000 % 3'600'000'000);
    data.factory_byte_1 = layout().return_mode_byte;
    data.factory_byte_2 = sensor.product_byte;
    return data;
  }

  /// Received `delay_ns` after its last firing.
  [[nodiscard]] drivers::Packet packet(std::size_t index, std::int64_t delay_ns = 0) const {
    drivers::Packet packet = wrap(data(index));
    packet.stamp.ns = packet_time_ns(index) + layout().packet_period_ns + delay_ns;
    packet.received_ns = static_cast<std::int64_t>(index) + 1;
    return packet;
  }

  static drivers::Packet wrap(const drivers::VelodyneDataPacket& data) {
    drivers::Packet packet;
    const auto bytes = drivers::encode(data);
    std::copy(bytes.begin(), bytes.end(), packet.data.begin());
    packet.size = static_cast<std::uint16_t>(bytes.size());
    return packet;
  }
};

/// Feeds packets and collects every scan.
inline std::vector<core::Scan> assemble(drivers::ScanAssembler& assembler,
                                        const std::vector<drivers::Packet>& packets) {
  std::vector<core::Scan> scans;
  for (const drivers::Packet& packet : packets) {
    if (!assembler.add(packet)) continue;
    scans.emplace_back();
    assembler.take_scan(scans.back());
  }
  return scans;
}

}  // namespace nilio::tests
