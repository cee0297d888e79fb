#include "nilio/core/clock.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"
#include "nilio/drivers/velodyne/detect.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "tools/bench/bench.hpp"
#include "tools/common/statistics.hpp"

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <functional>
#include <random>
#include <vector>

namespace nilio::tools::bench {

namespace {

using drivers::PacketLayout;
using drivers::VelodyneSensor;

constexpr std::int64_t kStartNs = 1'700'000'000'000'000'000;

/// Shares of the firings of a real VLP-16 in a street whose two returns differ, that have the last return
/// only, and the strongest only.
constexpr double kTwoReturns = 0.012;
constexpr double kLastOnly = 0.009;
constexpr double kStrongestOnly = 0.001;

/// CPU time of this thread, ns: other programs do not count.
std::int64_t cpu_ns() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return ns_of(now);
}

/// The other return of a firing: nearly always the same one.
drivers::VelodyneDataPacket::Entry other_return(drivers::VelodyneDataPacket::Entry last, double chance) {
  if (chance < kTwoReturns) last.distance = static_cast<std::uint16_t>(last.distance / 2);
  if (chance > 1.0 - kLastOnly) last = {};
  return last;
}

/// Replaces the strongest returns by those that belong to the last ones.
void pair_returns(drivers::VelodyneDataPacket& data, const PacketLayout& layout,
                  std::uniform_real_distribution<double>& uniform, std::mt19937& random) {
  for (std::size_t b = 0; b < drivers::kBlocksPerPacket; ++b) {
    if (layout.contents[b] != drivers::BlockContent::kStrongest) continue;
    const std::size_t first = b - b % layout.blocks_per_azimuth;
    for (std::size_t last = first; last < first + layout.blocks_per_azimuth; ++last) {
      if (layout.contents[last] != drivers::BlockContent::kLast ||
          layout.block_flags[last] != layout.block_flags[b])
        continue;
      for (std::size_t c = 0; c < drivers::kEntriesPerBlock; ++c) {
        auto& entry = data.blocks[last].entries[c];
        data.blocks[b].entries[c] = other_return(entry, uniform(random));
        if (uniform(random) < kStrongestOnly) entry = {};
      }
    }
  }
}

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
      if (layout.contents[b] == drivers::BlockContent::kPadding) continue;
      for (auto& entry : data.blocks[b].entries) {
        if (uniform(random) < missing) continue;
        const double metres = 3.0 + 60.0 * uniform(random) * uniform(random);
        entry = {static_cast<std::uint16_t>(metres / sensor.distance_resolution_m),
                 static_cast<std::uint8_t>(255.0 * uniform(random))};
      }
    }
    pair_returns(data, layout, uniform, random);
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
  // Every return counts as a point, the vehicle's own body included.
  config.min_range_m = 0.1;
  drivers::ScanAssembler assembler(sensor, config);
  core::Scan scan;
  DecodeTime result;
  const std::size_t warm_up = packets.size() * 2 / 5;
  std::int64_t begin_ns = cpu_ns();
  std::uint64_t points = 0;
  for (std::size_t i = 0; i < packets.size(); ++i) {
    if (i == warm_up) {
      begin_ns = cpu_ns();
      points = assembler.stats().points;
    }
    if (assembler.add(packets[i])) assembler.take_scan(scan);
  }
  const auto elapsed_ns = static_cast<double>(cpu_ns() - begin_ns);
  const auto measured = static_cast<double>(packets.size() - warm_up);
  result.ns_per_packet = elapsed_ns / measured;
  result.points_per_packet = static_cast<double>(assembler.stats().points - points) / measured;
  return result;
}

/// The same packets without a return.
std::vector<drivers::Packet> without_returns_of(std::vector<drivers::Packet> packets) {
  for (drivers::Packet& packet : packets) {
    if (!drivers::is_data_packet(packet)) continue;
    drivers::VelodyneDataPacket data = *drivers::decode(std::span(packet.data).first(packet.size));
    for (auto& block : data.blocks) block.entries.fill({});
    const auto bytes = drivers::encode(data);
    std::copy(bytes.begin(), bytes.end(), packet.data.begin());
  }
  return packets;
}

void print_header() {
  std::printf("%-13s %-20s %9s %8s %8s %10s %10s\n", "", "", "points", "median", "minimum", "without",
              "share of");
  std::printf("%-13s %-20s %9s %8s %8s %10s %10s\n", "model", "returns", "/packet", "ns/point", "ns/point",
              "returns ns", "one core");
}

void bench_packets(const VelodyneSensor& sensor, const PacketLayout& layout,
                   const std::vector<drivers::Packet>& full, const DecodeOptions& options) {
  const std::vector<drivers::Packet> empty = without_returns_of(full);
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

void bench_layout(const VelodyneSensor& sensor, const PacketLayout& layout, const DecodeOptions& options) {
  bench_packets(sensor, layout, make_packets(sensor, layout, options.seconds, options.missing), options);
}

/// Repeats the data packets of a capture for a second; its end and its beginning do not fit together, which
/// costs one packet.
core::Result<bool> bench_capture(const DecodeOptions& options) {
  core::Result<std::unique_ptr<drivers::PacketSource>> source = drivers::open_pcap(options.capture, {});
  if (!source) return source.error();
  std::vector<drivers::Packet> packets;
  std::vector<drivers::Packet> slots(64);
  for (auto read = (*source)->read(slots, {}); read.state == drivers::SourceState::kData;
       read = (*source)->read(slots, {}))
    packets.insert(packets.end(), slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(read.count));
  std::erase_if(packets, std::not_fn(drivers::is_data_packet));
  const drivers::VelodyneDetection detection =
      drivers::detect_velodyne(std::span(packets).first(std::min<std::size_t>(packets.size(), 64)));
  if (!detection.model)
    return core::Error{options.capture + ": sensor model cannot be identified (" + detection.evidence + ")"};
  const VelodyneSensor sensor = drivers::make_velodyne_sensor(*detection.model);
  const PacketLayout& layout = *sensor.layout(detection.mode);
  const auto wanted =
      static_cast<std::size_t>(options.seconds * 1e9 / static_cast<double>(layout.packet_period_ns));
  const std::size_t once = packets.size();
  while (packets.size() < wanted) packets.push_back(packets[packets.size() - once]);
  print_header();
  bench_packets(sensor, layout, packets, options);
  return true;
}

}  // namespace

core::Result<bool> run_decode_bench(const DecodeOptions& options) {
  if (!options.capture.empty()) return bench_capture(options);
  print_header();
  for (const drivers::VelodyneModel model : drivers::velodyne_models()) {
    const VelodyneSensor sensor = drivers::make_velodyne_sensor(model);
    for (const PacketLayout& layout : sensor.layouts) bench_layout(sensor, layout, options);
  }
  VelodyneSensor interpolated = drivers::make_velodyne_sensor(drivers::VelodyneModel::kHdl64eS3);
  drivers::set_azimuth_interpolation(interpolated, true);
  interpolated.name += " *";
  for (const PacketLayout& layout : interpolated.layouts) bench_layout(interpolated, layout, options);
  std::printf("* azimuth interpolated, which is off by default for the HDL-64E\n");
  return true;
}

}  // namespace nilio::tools::bench
