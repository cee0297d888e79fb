#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/velodyne/detect.hpp"

#include "tests/support/drivers_support.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/read_all.hpp"

#include <random>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;

namespace {

constexpr std::array<const char*, 8> kMutatedCaptures{
    "hdl32e_highway_moving.pcap", "hdl32e_monterey_stationary.pcap",
    "vlp16_gps_stationary.pcap",  "vlp16_preproduction_20hz_50rev.pcap",
    "vlp16_short.pcap",           "golden/vlp16.pcap",
    "golden/vlp32.pcap",          "golden/vls128.pcap"};
#if defined(__SANITIZE_ADDRESS__)
constexpr std::uint32_t kMutations = 60;
#else
constexpr std::uint32_t kMutations = 250;
#endif
/// Of each capture: some revolutions.
constexpr std::size_t kPacketsOfCapture = 700;

/// Damages, moves, copies and removes packets; each kind in a share of the packets drawn first.
std::vector<Packet> mutate(const std::vector<Packet>& packets, std::mt19937& random) {
  std::array<std::uint_fast32_t, 7> one_in{};
  for (std::uint_fast32_t& share : one_in) share = random() % 3 == 0 ? 2 + random() % 200 : 0;
  const auto hits = [&](std::size_t kind) { return one_in[kind] > 0 && random() % one_in[kind] == 0; };
  std::vector<Packet> result;
  for (const Packet& packet : packets) {
    if (hits(0)) continue;
    result.push_back(packet);
    Packet& copy = result.back();
    if (hits(1)) copy.data[random() % kPacketCapacity] ^= static_cast<std::uint8_t>(1U << random() % 8);
    if (hits(2)) {
      for (std::size_t i = 1200; i < 1206; ++i) copy.data[i] = static_cast<std::uint8_t>(random());
    }
    if (hits(3)) copy.size = static_cast<std::uint16_t>(random() % kPacketCapacity);
    if (hits(4)) copy.stamp.ns += static_cast<std::int64_t>(random() % 4'000'000'000U) - 2'000'000'000;
    if (hits(5)) result.insert(result.end(), 1 + random() % 3, copy);
    if (hits(6)) std::swap(result[random() % result.size()], result.back());
  }
  return result;
}

}  // namespace

TEST_CASE("mutated real captures end with every firing accounted for", "[mutated_captures]") {
  for (const char* file : kMutatedCaptures) {
    NILIO_REQUIRE_DATA(path, std::string("velodyne/") + file);
    auto source = open_pcap(path.string(), {});
    REQUIRE(source.ok());
    std::vector<Packet> packets = nilio::tests::read_all(**source);
    packets.resize(std::min(packets.size(), kPacketsOfCapture));
    const VelodyneModel model = detect_velodyne(packets).model.value_or(VelodyneModel::kVlp16);
    for (std::uint32_t seed = 0; seed < kMutations; ++seed) {
      std::mt19937 random(seed);
      const std::vector<Packet> mutated = mutate(packets, random);
      INFO(file << ", seed " << seed);
      detect_velodyne(std::span(mutated).first(std::min<std::size_t>(mutated.size(), 64)));
      const ScanAssemblerConfig config{.time_source = static_cast<TimeSource>(seed % 3),
                                       .min_coverage = seed % 2 == 0 ? 0.8 : 0.0};
      ScanAssembler assembler(make_velodyne_sensor(model), config);
      core::Time last_end{INT64_MIN};
      std::uint64_t data = 0;
      core::Scan scan;
      for (const Packet& packet : mutated) {
        data += is_data_packet(packet) ? 1 : 0;
        if (!assembler.add(packet)) continue;
        assembler.take_scan(scan);
        REQUIRE(scan.start > last_end);
        REQUIRE(scan.end >= scan.start);
        last_end = scan.end;
      }
      assembler.finish();
      const ScanAssemblerStats& stats = assembler.stats();
      REQUIRE(stats.packets == data);
      REQUIRE(assembler.open_firings() == 0);
      REQUIRE(stats.firings ==
              stats.firings_in_scans + stats.firings_discarded + stats.firings_bad + stats.firings_late);
    }
  }
}
