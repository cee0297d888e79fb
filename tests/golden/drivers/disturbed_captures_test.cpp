#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/velodyne/detect.hpp"

#include "tests/support/disturbed_packets.hpp"
#include "tests/support/drivers_support.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/read_all.hpp"

#include <set>
#include <tuple>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using nilio::tests::disturb;
using nilio::tests::Disturbance;
using nilio::tests::disturbances;

namespace {

struct Capture {
  const char* file;
  VelodyneModel model;
  ReturnMode mode;
  /// The factory bytes are those of the model.
  bool certain;
  bool limited_view = false;
};

constexpr std::array<Capture, 8> kCaptures{{
    {"hdl32e_highway_moving.pcap", VelodyneModel::kHdl32e, ReturnMode::kSingle, true},
    {"hdl32e_monterey_stationary.pcap", VelodyneModel::kHdl32e, ReturnMode::kSingle, true},
    {"vlp16_gps_stationary.pcap", VelodyneModel::kVlp16, ReturnMode::kSingle, true},
    {"vlp16_preproduction_20hz_50rev.pcap", VelodyneModel::kVlp16, ReturnMode::kSingle, false},
    {"vlp16_short.pcap", VelodyneModel::kVlp16, ReturnMode::kSingle, false},
    {"golden/vlp16.pcap", VelodyneModel::kVlp16, ReturnMode::kDual, true},
    {"golden/vlp32.pcap", VelodyneModel::kVlp32c, ReturnMode::kSingle, true, true},
    {"golden/vls128.pcap", VelodyneModel::kVls128, ReturnMode::kSingle, true},
}};

std::vector<Packet> data_packets(const std::filesystem::path& path) {
  auto source = open_pcap(path.string(), {});
  REQUIRE(source.ok());
  std::vector<Packet> packets = nilio::tests::read_all(**source);
  std::erase_if(packets, [](const Packet& packet) { return packet.size != kDataPacketSize; });
  return packets;
}

/// Firings as points know them.
std::set<std::tuple<std::int64_t, int, float, float, float>> points_of(const std::vector<core::Scan>& scans) {
  std::set<std::tuple<std::int64_t, int, float, float, float>> points;
  for (const core::Scan& scan : scans) {
    for (const core::Point& p : scan.points)
      points.emplace(scan.start.ns + p.time_offset_ns, p.ring, p.x, p.y, p.z);
  }
  return points;
}

}  // namespace

TEST_CASE("real sensors are identified from lost, duplicated and reordered packets", "[disturbed_captures]") {
  for (const Capture& capture : kCaptures) {
    NILIO_REQUIRE_DATA(path, std::string("velodyne/") + capture.file);
    const std::vector<Packet> packets = data_packets(path);
    for (const Disturbance& how : disturbances()) {
      for (std::uint32_t seed = 1; seed <= 10; ++seed) {
        std::vector<Packet> disturbed = disturb(packets, how, seed);
        // Wherever the stream is joined.
        const std::size_t first = disturbed.size() > 64 ? seed * 7919 % (disturbed.size() - 64) : 0;
        const std::size_t count = std::min<std::size_t>(64, disturbed.size());
        const VelodyneDetection detection = detect_velodyne(std::span(disturbed).subspan(first, count));
        INFO(capture.file << ", " << how.name << " seed " << seed << ": " << detection.evidence);
        REQUIRE(detection.model == capture.model);
        REQUIRE(detection.mode == capture.mode);
        REQUIRE(detection.uncertainty.empty() == capture.certain);
      }
    }
  }
}

TEST_CASE("disturbed captures lose the firings of lost packets and no others, and double none",
          "[disturbed_captures]") {
  for (const Capture& capture : kCaptures) {
    NILIO_REQUIRE_DATA(path, std::string("velodyne/") + capture.file);
    const std::vector<Packet> packets = data_packets(path);
    const ScanAssemblerConfig config{.time_source = TimeSource::kSensor, .min_coverage = 0.0};
    const auto run = [&](const std::vector<Packet>& stream, ScanAssemblerStats& stats) {
      ScanAssembler assembler(make_velodyne_sensor(capture.model), config);
      std::vector<core::Scan> scans = nilio::tests::assemble(assembler, stream);
      if (assembler.finish()) assembler.take_scan(scans.emplace_back());
      stats = assembler.stats();
      return scans;
    };
    ScanAssemblerStats whole;
    run(packets, whole);
    for (const Disturbance& how : disturbances()) {
      const std::vector<Packet> stream = disturb(packets, how, 5);
      ScanAssemblerStats stats;
      const std::vector<core::Scan> scans = run(stream, stats);
      const std::size_t different = how.duplicated ? stream.size() / 2 : stream.size();
      INFO(capture.file << ", " << how.name);
      // A packet that holds the blind sector lasts longer than the reorder window: packets that overtake it
      // look like a clock that was set.
      if (capture.limited_view) {
        if (how.reordered == 5) continue;
        CHECK(stats.time_jumps + stats.host_clock_jumps + stats.mode_changes == 0);
        CHECK(stats.damaged_stamps <= 4);
        continue;
      }
      CHECK(stats.duplicate_packets == stream.size() - different);
      CHECK(stats.time_jumps + stats.host_clock_jumps + stats.damaged_stamps + stats.mode_changes == 0);
      const std::uint64_t per_packet = whole.firings / whole.packets;
      CHECK(stats.firings == different * per_packet);
      CHECK(stats.firings ==
            stats.firings_in_scans + stats.firings_discarded + stats.firings_bad + stats.firings_late);
      std::size_t points = 0;
      for (const core::Scan& scan : scans) points += scan.points.size();
      CHECK(points_of(scans).size() == points);
      if (how.reordered == 0) CHECK(stats.firings_late == 0);
      // Lost packets are counted, except at the ends of the recording.
      const std::uint64_t lost = packets.size() - different;
      CHECK(stats.lost_packets <= lost);
      CHECK(stats.lost_packets + 12 >= lost);
    }
  }
}

TEST_CASE("evenly lost packets of real captures leave a scan for every revolution", "[disturbed_captures]") {
  for (const Capture& capture : kCaptures) {
    NILIO_REQUIRE_DATA(path, std::string("velodyne/") + capture.file);
    const std::vector<Packet> packets = data_packets(path);
    const auto scans_of = [&](const std::vector<Packet>& stream) {
      ScanAssembler assembler(make_velodyne_sensor(capture.model), {});
      return nilio::tests::assemble(assembler, stream).size();
    };
    const std::size_t expected = scans_of(packets);
    for (const double lost : {0.2, 0.5}) {
      for (std::uint32_t seed = 1; seed <= 5; ++seed) {
        INFO(capture.file << ", " << lost << " lost, seed " << seed);
        // The last revolution may end with the recording; a blind sector is known after three revolutions.
        const std::size_t scans = scans_of(disturb(packets, {"", lost, false, 0}, seed));
        CHECK(scans + (capture.limited_view ? 3 : 1) >= expected);
        CHECK(scans <= expected + 1);
      }
    }
  }
}
