#include "tests/support/drivers_support.hpp"

#include <algorithm>
#include <map>
#include <random>
#include <set>
#include <tuple>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using nilio::tests::TurningSensor;

namespace {

constexpr std::size_t kPackets = 12'000;

struct Stream {
  VelodyneModel model;
  ReturnMode mode;
};

constexpr std::array<Stream, 7> kStreams{{{VelodyneModel::kVlp16, ReturnMode::kSingle},
                                          {VelodyneModel::kVlp16, ReturnMode::kDual},
                                          {VelodyneModel::kHdl32e, ReturnMode::kSingle},
                                          {VelodyneModel::kVlp32c, ReturnMode::kDual},
                                          {VelodyneModel::kVls128, ReturnMode::kSingle},
                                          {VelodyneModel::kHdl64eS2, ReturnMode::kSingle},
                                          {VelodyneModel::kHdl64eS3, ReturnMode::kDual}}};

/// Faults that the generator put into the packets.
struct Faults {
  std::uint64_t lost = 0;
  std::uint64_t duplicated = 0;
  std::uint64_t late = 0;
  std::uint64_t damaged_steps = 0;
  std::uint64_t wrong_length = 0;
};

struct Generated {
  std::vector<Packet> packets;
  Faults faults;
  std::set<std::size_t> delivered;
  std::size_t newest = 0;

  void deliver(std::size_t index, const Packet& packet) {
    packets.push_back(packet);
    if (!delivered.insert(index).second) {
      ++faults.duplicated;
    } else if (index < newest) {
      ++faults.late;
    }
    newest = std::max(newest, index);
  }
};

/// Damages one block so that its azimuth step is unusable.
void damage(VelodyneDataPacket& data, const PacketLayout& layout, std::mt19937& random) {
  std::size_t block = random() % kBlocksPerPacket;
  while (layout.contents[block] == BlockContent::kPadding) block = random() % kBlocksPerPacket;
  VelodyneDataPacket::Block& damaged = data.blocks[block];
  switch (random() % 3) {
    case 0:
      damaged.flag = static_cast<std::uint16_t>(damaged.flag ^ (1U << random() % 16));
      break;
    case 1:
      damaged.azimuth = static_cast<std::uint16_t>(36001 + random() % 29000);
      break;
    default:
      damaged.azimuth = static_cast<std::uint16_t>((damaged.azimuth + 9000 + random() % 18000) % 36000);
  }
}

/// A stream with one fault in every thirty packets; the first and the last packet are kept, so that every gap
/// is visible.
Generated generate(const TurningSensor& source, std::uint32_t seed) {
  std::mt19937 random(seed);
  Generated result;
  std::multimap<std::size_t, std::pair<std::size_t, Packet>> later;
  for (std::size_t i = 0; i < kPackets; ++i) {
    const bool edge = i < 20 || i + 20 >= kPackets;
    const std::size_t fate = edge ? 999 : random() % 200;
    Packet packet = source.packet(i);
    if (fate == 0) {
      ++result.faults.lost;
    } else if (fate == 1) {
      // A burst.
      const std::size_t burst = 1 + random() % 12;
      result.faults.lost += std::min(burst, kPackets - 20 - i);
      i += std::min(burst, kPackets - 20 - i) - 1;
    } else if (fate == 2) {
      later.emplace(i + random() % 8, std::pair(i, packet));
      result.deliver(i, packet);
    } else if (fate == 3) {
      later.emplace(i + 1 + random() % 8, std::pair(i, packet));
    } else if (fate == 4) {
      VelodyneDataPacket data = source.data(i);
      damage(data, source.layout(), random);
      ++result.faults.damaged_steps;
      const Packet original = packet;
      packet = TurningSensor::wrap(data);
      packet.stamp = original.stamp;
      result.deliver(i, packet);
    } else if (fate == 5) {
      ++result.faults.wrong_length;
      Packet wrong = packet;
      wrong.size = static_cast<std::uint16_t>(random() % kDataPacketSize);
      if (wrong.size == kPositionPacketSize) ++wrong.size;
      result.packets.push_back(wrong);
      result.deliver(i, packet);
    } else {
      result.deliver(i, packet);
    }
    for (auto due = later.begin(); due != later.end() && due->first <= i; due = later.erase(due)) {
      due->second.second.stamp = source.packet(i).stamp;
      result.deliver(due->second.first, due->second.second);
    }
  }
  return result;
}

struct Outcome {
  std::vector<core::Scan> scans;
  ScanAssemblerStats stats;
};

Outcome run(const TurningSensor& source, const std::vector<Packet>& packets,
            const ScanAssemblerConfig& config) {
  ScanAssembler assembler(source.sensor, config);
  Outcome outcome;
  outcome.scans = nilio::tests::assemble(assembler, packets);
  if (assembler.finish()) assembler.take_scan(outcome.scans.emplace_back());
  outcome.stats = assembler.stats();
  REQUIRE(assembler.open_firings() == 0);
  return outcome;
}

/// Checks that every point is a firing that was sent, without duplicates, and that scans do not overlap.
void require_exactly_once(const Outcome& outcome) {
  std::vector<std::tuple<std::int64_t, int>> firings;
  for (std::size_t i = 0; i < outcome.scans.size(); ++i) {
    const core::Scan& scan = outcome.scans[i];
    REQUIRE(scan.end >= scan.start);
    if (i > 0) REQUIRE(scan.start > outcome.scans[i - 1].end);
    for (const core::Point& p : scan.points) {
      const core::Time time{scan.start.ns + p.time_offset_ns};
      if (time < scan.start || time > scan.end) FAIL("a point outside its scan's time");
      firings.emplace_back(time.ns, p.ring);
    }
  }
  std::sort(firings.begin(), firings.end());
  REQUIRE(std::adjacent_find(firings.begin(), firings.end()) == firings.end());
  const ScanAssemblerStats& stats = outcome.stats;
  CHECK(firings.size() == stats.firings_in_scans);
  CHECK(stats.firings ==
        stats.firings_in_scans + stats.firings_discarded + stats.firings_bad + stats.firings_late);
}

}  // namespace

TEST_CASE("every firing is in one scan or counted, whatever happens to the packets", "[exactly_once]") {
  for (const Stream& stream : kStreams) {
    for (const std::uint32_t seed : {1U, 2U}) {
      const TurningSensor source{
          .sensor = make_velodyne_sensor(stream.model), .start_azimuth_deg = 180.0, .mode = stream.mode};
      INFO(source.sensor.name << " " << return_mode_name(stream.mode) << " seed " << seed);
      const Generated generated = generate(source, seed);
      const Outcome outcome = run(source, generated.packets, {.max_range_m = 1000.0, .min_coverage = 0.0});
      require_exactly_once(outcome);
      const ScanAssemblerStats& stats = outcome.stats;
      const Faults& faults = generated.faults;
      REQUIRE(faults.lost + faults.duplicated + faults.late + faults.damaged_steps + faults.wrong_length >
              250);
      CHECK(stats.packets == kPackets - faults.lost + faults.duplicated);
      CHECK(stats.bad_length == faults.wrong_length);
      CHECK(stats.lost_packets == faults.lost);
      CHECK(stats.duplicate_packets == faults.duplicated);
      CHECK(stats.late_packets == faults.late);
      CHECK(stats.firings == (kPackets - faults.lost) * source.layout().firings_per_packet());
      CHECK(stats.firings_bad == faults.damaged_steps * source.layout().firings_per_azimuth);
      CHECK(stats.firings_discarded == 0);
      CHECK(stats.time_jumps + stats.host_clock_jumps + stats.mode_changes == 0);
    }
  }
}

TEST_CASE("time never goes back and no firing is lost when clocks are set", "[exactly_once]") {
  for (const TimeSource time_source : {TimeSource::kAuto, TimeSource::kSensor, TimeSource::kHost}) {
    for (const std::int64_t sensor_ahead_ns : {std::int64_t{0}, std::int64_t{1'234'000'000'000}}) {
      TurningSensor source{.sensor = make_velodyne_sensor(VelodyneModel::kVlp16),
                           .start_azimuth_deg = 180.0,
                           .sensor_ahead_ns = sensor_ahead_ns};
      INFO("time source " << static_cast<int>(time_source) << " ahead " << sensor_ahead_ns);
      std::mt19937 random(7);
      std::vector<Packet> packets;
      std::uint64_t sensor_jumps = 0;
      std::uint64_t host_jumps = 0;
      std::int64_t host_shift_ns = 0;
      for (std::size_t i = 0; i < kPackets; ++i) {
        if (i > 0 && i % 1000 == 0) {
          // 3 s to 20 min, forward or backward.
          const std::int64_t size_ns = (3 + static_cast<std::int64_t>(random() % 1200)) * 1'000'000'000;
          const std::int64_t jump_ns = random() % 2 == 0 ? size_ns : -size_ns;
          if (i % 2000 == 0) {
            source.sensor_ahead_ns += jump_ns;
            ++sensor_jumps;
          } else {
            host_shift_ns += jump_ns;
            ++host_jumps;
          }
        }
        packets.push_back(source.packet(i));
        packets.back().stamp.ns += host_shift_ns;
      }
      const Outcome outcome =
          run(source, packets, {.time_source = time_source, .max_range_m = 1000.0, .min_coverage = 0.0});
      require_exactly_once(outcome);
      CHECK(outcome.stats.time_jumps == sensor_jumps);
      CHECK(outcome.stats.host_clock_jumps == host_jumps);
      CHECK(outcome.stats.firings_in_scans == kPackets * 384);
      CHECK(outcome.stats.lost_packets == 0);
    }
  }
}
