#include "tests/support/drivers_support.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using nilio::tests::assemble;
using nilio::tests::TurningSensor;

namespace {

/// Sensor clock in step with the host's, and far ahead of it.
constexpr std::array<std::int64_t, 2> kAhead{0, 1'234'000'000'000};

#if defined(__SANITIZE_ADDRESS__)
/// AddressSanitizer takes ten times as long: it sees every fifth bit, the release build all.
constexpr std::size_t kBitStep = 5;
#else
constexpr std::size_t kBitStep = 1;
#endif

struct FlippedStream {
  VelodyneModel model;
  ReturnMode mode;
};

constexpr std::array<FlippedStream, 5> kFlippedStreams{{{VelodyneModel::kVlp16, ReturnMode::kSingle},
                                                        {VelodyneModel::kVlp16, ReturnMode::kDual},
                                                        {VelodyneModel::kHdl32e, ReturnMode::kSingle},
                                                        {VelodyneModel::kHdl64eS2, ReturnMode::kSingle},
                                                        {VelodyneModel::kVls128, ReturnMode::kDual}}};

TurningSensor make_source(const FlippedStream& stream, double revolutions_per_second, std::int64_t ahead_ns) {
  return {.sensor = make_velodyne_sensor(stream.model),
          .revolutions_per_second = revolutions_per_second,
          .start_azimuth_deg = 170.0,
          .sensor_ahead_ns = ahead_ns,
          .mode = stream.mode};
}

std::vector<Packet> packets_of(const TurningSensor& source, double seconds) {
  const auto count =
      static_cast<std::size_t>(seconds * 1e9 / static_cast<double>(source.layout().packet_period_ns));
  std::vector<Packet> packets;
  for (std::size_t i = 0; i < count; ++i) packets.push_back(source.packet(i));
  return packets;
}

struct FlippedOutcome {
  std::vector<core::Scan> scans;
  ScanAssemblerStats stats;
};

FlippedOutcome run(const TurningSensor& source, const std::vector<Packet>& packets) {
  ScanAssembler assembler(source.sensor, {.max_range_m = 1000.0});
  FlippedOutcome outcome;
  outcome.scans = assemble(assembler, packets);
  assembler.finish();
  outcome.stats = assembler.stats();
  CHECK(outcome.stats.firings == outcome.stats.firings_in_scans + outcome.stats.firings_discarded +
                                     outcome.stats.firings_bad + outcome.stats.firings_late);
  return outcome;
}

/// The scans are those of the undamaged packets, less `firings` at most.
void require_unharmed(const FlippedOutcome& outcome, const FlippedOutcome& expected, std::uint64_t firings) {
  REQUIRE(outcome.stats.time_jumps + outcome.stats.host_clock_jumps == 0);
  REQUIRE(outcome.stats.partial_scans == expected.stats.partial_scans);
  REQUIRE(outcome.scans.size() == expected.scans.size());
  for (std::size_t i = 0; i < expected.scans.size(); ++i) {
    const core::Scan& scan = outcome.scans[i];
    REQUIRE(std::abs((scan.start - expected.scans[i].start).ns) < 2'000'000);
    REQUIRE(std::abs((scan.end - expected.scans[i].end).ns) < 2'000'000);
    REQUIRE(scan.points.size() + firings >= expected.scans[i].points.size());
    REQUIRE(scan.points.size() <= expected.scans[i].points.size() + firings);
  }
}

}  // namespace

TEST_CASE("one flipped bit of a time stamp costs its packet at most", "[flipped_bits]") {
  for (const FlippedStream& stream : kFlippedStreams) {
    for (const std::int64_t ahead_ns : kAhead) {
      const TurningSensor source = make_source(stream, 10.0, ahead_ns);
      std::vector<Packet> packets = packets_of(source, 0.35);
      const FlippedOutcome expected = run(source, packets);
      REQUIRE(expected.scans.size() >= 2);
      const std::uint64_t per_packet = source.layout().firings_per_packet();
      for (const double place : {0.06, 0.13, 0.2201, 0.31}) {
        const auto damaged = static_cast<std::size_t>(place / 0.35 * static_cast<double>(packets.size()));
        for (std::size_t bit = 0; bit < 32; bit += kBitStep) {
          const Packet original = packets[damaged];
          packets[damaged].data[1200 + bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
          INFO(source.sensor.name << " " << return_mode_name(stream.mode) << ", ahead " << ahead_ns
                                  << ", packet " << damaged << ", bit " << bit);
          const FlippedOutcome outcome = run(source, packets);
          packets[damaged] = original;
          // The stamp of 33 ms looks like packets out of order; its packet may extend the scan's end.
          if (bit >= 16) {
            require_unharmed(outcome, expected, per_packet);
            REQUIRE(outcome.stats.damaged_stamps == 1);
            REQUIRE(outcome.stats.lost_packets == 0);
            REQUIRE(outcome.stats.firings_bad == per_packet);
          } else {
            REQUIRE(outcome.stats.time_jumps + outcome.stats.host_clock_jumps == 0);
            REQUIRE(outcome.scans.size() == expected.scans.size());
          }
        }
      }
    }
  }
}

TEST_CASE("one flipped bit of an azimuth costs its step at most", "[flipped_bits]") {
  for (const FlippedStream& stream : kFlippedStreams) {
    for (const double revolutions_per_second : {5.0, 20.0}) {
      const TurningSensor source = make_source(stream, revolutions_per_second, 0);
      std::vector<Packet> packets = packets_of(source, 2.1 / revolutions_per_second);
      // An error of up to 0.64 degree is within the encoder's jitter and can move the cut.
      const auto jitter_steps =
          static_cast<std::uint64_t>(2.0 + 64.0 / (36'000.0 * revolutions_per_second * 1e-9 *
                                                   static_cast<double>(source.layout().azimuth_period_ns)));
      const FlippedOutcome expected = run(source, packets);
      REQUIRE_FALSE(expected.scans.empty());
      // Around the cut, and in the middle of a scan.
      for (const double turns : {1.02, 1.027, 1.035, 1.5}) {
        const auto damaged = static_cast<std::size_t>(turns / 2.1 * static_cast<double>(packets.size()));
        for (std::size_t block = 0; block < kBlocksPerPacket; block += 5) {
          if (source.layout().contents[block] == BlockContent::kPadding) continue;
          for (std::size_t bit = 0; bit < 16; bit += kBitStep) {
            const Packet original = packets[damaged];
            packets[damaged].data[100 * block + 2 + bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
            INFO(source.sensor.name << " " << return_mode_name(stream.mode) << ", " << revolutions_per_second
                                    << " Hz, packet " << damaged << ", block " << block << ", bit " << bit);
            const FlippedOutcome outcome = run(source, packets);
            packets[damaged] = original;
            require_unharmed(outcome, expected, jitter_steps * source.layout().firings_per_azimuth);
            REQUIRE(outcome.stats.firings_bad <= source.layout().firings_per_azimuth);
            REQUIRE(outcome.stats.lost_packets + outcome.stats.damaged_stamps == 0);
          }
        }
      }
    }
  }
}
