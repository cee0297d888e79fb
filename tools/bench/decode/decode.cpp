#include "nilio/drivers/velodyne/decoder.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "tools/bench/bench.hpp"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <random>
#include <vector>

namespace nilio::tools::bench {

namespace {

using drivers::PacketLayout;
using drivers::VelodyneSensor;

constexpr std::int64_t kStartNs = 1'700'000'000'000'000'000;

/// Packets of a sensor at 600 revolutions per minute, with random ranges of 3 to 63 m; `missing` is the share
/// of firings without a return.
std::vector<drivers::Packet> make_packets(const VelodyneSensor& sensor, const PacketLayout& layout,
                                          double seconds, double missing) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const auto count = static_cast<std::size_t>(seconds * 1e9 / static_cast<double>(layout.packet_period_ns));
  std::vector<drivers::Packet> packets(count);
  for (std::size_t i = 0; i < count; ++i) {
    drivers::VelodyneDataPacket data;
    const std::int64_t time_ns = kStartNs + static_cast<std::int64_t>(i) * layout.packet_period_ns;
    for (std::size_t b = 0; b < drivers::kBlocksPerPacket; ++b) {
      const std::size_t step = i * layout.azimuth_steps() + b / layout.blocks_per_azimuth;
      const double turns = static_cast<double>(step) * static_cast<double>(layout.azimuth_period_ns) * 1e-8;
      data.blocks[b].flag = layout.block_flags[b];
      data.blocks[b].azimuth = static_cast<std::uint16_t>(
          static_cast<std::uint64_t>(turns * drivers::kAzimuthModulus) % drivers::kAzimuthModulus);
      for (auto& entry : data.blocks[b].entries) {
        if (uniform(random) < missing) continue;
        const double metres = 3.0 + 60.0 * uniform(random) * uniform(random);
        entry = {static_cast<std::uint16_t>(metres / sensor.distance_resolution_m),
                 static_cast<std::uint8_t>(255.0 * uniform(random))};
      }
    }
    data.timestamp_us = static_cast<std::uint32_t>(time_ns / 1000 % 3'600'000'000);
    data.factory_byte_1 = layout.return_mode_byte;
    data.factory_byte_2 = sensor.product_byte;
    const auto bytes = drivers::encode(data);
    std::copy(bytes.begin(), bytes.end(), packets[i].data.begin());
    packets[i].size = static_cast<std::uint16_t>(bytes.size());
    packets[i].stamp.ns = time_ns + layout.packet_period_ns;
  }
  return packets;
}

struct DecodeTime {
  double ns_per_packet = 0.0;
  double points_per_packet = 0.0;
};

/// One pass over the packets, scans taken as the odometry does. The first part is not measured: the buffers
/// of all scans have to be written once.
DecodeTime run(const VelodyneSensor& sensor, const std::vector<drivers::Packet>& packets) {
  drivers::ScanAssemblerConfig config;
  config.min_coverage = 0.0;
  drivers::ScanAssembler assembler(sensor, config);
  core::Scan scan;
  DecodeTime result;
  const std::size_t warm_up = packets.size() * 2 / 5;
  auto begin = std::chrono::steady_clock::now();
  std::uint64_t points = 0;
  for (std::size_t i = 0; i < packets.size(); ++i) {
    if (i == warm_up) {
      begin = std::chrono::steady_clock::now();
      points = assembler.stats().points;
    }
    if (assembler.add(packets[i])) assembler.take_scan(scan);
  }
  const std::chrono::duration<double, std::nano> elapsed = std::chrono::steady_clock::now() - begin;
  const auto measured = static_cast<double>(packets.size() - warm_up);
  result.ns_per_packet = elapsed.count() / measured;
  result.points_per_packet = static_cast<double>(assembler.stats().points - points) / measured;
  return result;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

void bench_layout(const VelodyneSensor& sensor, const PacketLayout& layout, const DecodeOptions& options) {
  const std::vector<drivers::Packet> full = make_packets(sensor, layout, options.seconds, options.missing);
  const std::vector<drivers::Packet> empty = make_packets(sensor, layout, options.seconds, 1.0);
  std::vector<double> full_ns;
  std::vector<double> empty_ns;
  double points_per_packet = 0.0;
  for (int round = 0; round <= options.rounds; ++round) {
    const DecodeTime measured = run(sensor, full);
    const double without_returns = run(sensor, empty).ns_per_packet;
    points_per_packet = measured.points_per_packet;
    // The first round fills the caches.
    if (round == 0) continue;
    full_ns.push_back(measured.ns_per_packet);
    empty_ns.push_back(without_returns);
  }
  const double per_packet = median(full_ns);
  const double share = per_packet / static_cast<double>(layout.packet_period_ns);
  std::printf("%-13s %-20s %9.0f %8.2f %8.2f %10.0f %8.2f %%\n", sensor.name.c_str(),
              std::string(drivers::return_mode_name(layout.mode)).c_str(), points_per_packet,
              per_packet / points_per_packet,
              *std::min_element(full_ns.begin(), full_ns.end()) / points_per_packet, median(empty_ns),
              100.0 * share);
}

}  // namespace

void run_decode_bench(const DecodeOptions& options) {
  std::printf("%-13s %-20s %9s %8s %8s %10s %10s\n", "", "", "points", "median", "minimum", "without",
              "share of");
  std::printf("%-13s %-20s %9s %8s %8s %10s %10s\n", "model", "returns", "/packet", "ns/point", "ns/point",
              "returns ns", "one core");
  for (const drivers::VelodyneModel model : drivers::velodyne_models()) {
    const VelodyneSensor sensor = drivers::make_velodyne_sensor(model);
    for (const PacketLayout& layout : sensor.layouts) bench_layout(sensor, layout, options);
  }
  VelodyneSensor interpolated = drivers::make_velodyne_sensor(drivers::VelodyneModel::kHdl64eS3);
  drivers::set_azimuth_interpolation(interpolated, true);
  interpolated.name += " *";
  for (const PacketLayout& layout : interpolated.layouts) bench_layout(interpolated, layout, options);
  std::printf("* azimuth interpolated, which is off by default for the HDL-64E\n");
}

}  // namespace nilio::tools::bench
