#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/velodyne/detect.hpp"

#include "tests/support/drivers_support.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/read_all.hpp"

#include <cmath>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using nilio::tests::read_all;

namespace {

std::size_t count_port(const std::vector<Packet>& packets, std::uint16_t port, std::size_t size) {
  return static_cast<std::size_t>(std::count_if(packets.begin(), packets.end(), [&](const Packet& packet) {
    return packet.destination_port == port && packet.size == size;
  }));
}

}  // namespace

TEST_CASE("a short VLP-16 capture is read completely and recognised", "[captures]") {
  NILIO_REQUIRE_DATA(path, "velodyne/vlp16_short.pcap");
  auto source = open_pcap(path.string(), {});
  REQUIRE(source.ok());
  const std::vector<Packet> packets = read_all(**source);
  CHECK(count_port(packets, 2368, kDataPacketSize) == 84);
  CHECK(count_port(packets, 8308, kPositionPacketSize) == 16);
  CHECK((*source)->stats().delivered == 100);
  CHECK((*source)->stats().malformed == 0);
  // The product byte is that of an HDL-32E; the packet period is not.
  CHECK(detect_velodyne(packets).model == VelodyneModel::kVlp16);
}

TEST_CASE("a VLP-16 capture gives complete revolutions of plausible points", "[captures]") {
  NILIO_REQUIRE_DATA(path, "velodyne/vlp16_gps_stationary.pcap");
  auto source = open_pcap(path.string(), {});
  REQUIRE(source.ok());
  const std::vector<Packet> packets = read_all(**source);
  CHECK(count_port(packets, 2368, kDataPacketSize) == 293);
  CHECK(count_port(packets, 8308, kPositionPacketSize) == 57);
  ScanAssembler assembler(make_velodyne_sensor(VelodyneModel::kVlp16), {});
  const std::vector<core::Scan> scans = nilio::tests::assemble(assembler, packets);
  CHECK(detect_velodyne(packets).model == VelodyneModel::kVlp16);
  CHECK(assembler.stats().packets == 293);
  CHECK(assembler.stats().firings_bad == 0);
  CHECK(assembler.stats().lost_packets == 0);
  CHECK(assembler.stats().time_jumps == 0);
  REQUIRE(scans.size() >= 2);
  for (const core::Scan& scan : scans) {
    CHECK(scan.coverage_deg > 355.0F);
    CHECK((scan.end - scan.start).seconds() == Approx(0.1).margin(0.005));
    CHECK(scan.points.size() > 5000);
    for (const core::Point& p : scan.points) {
      const float range = std::hypot(p.x, p.y, p.z);
      REQUIRE((range > 0.9F && range < 121.0F));
      REQUIRE((p.ring < 16 && p.time_offset_ns >= 0));
    }
  }
}

TEST_CASE("a capture whose IP lengths are wrong is read by its UDP lengths", "[captures]") {
  NILIO_REQUIRE_DATA(path, "velodyne/vlp16_preproduction_20hz_50rev.pcap");
  auto source = open_pcap(path.string(), {});
  REQUIRE(source.ok());
  const std::vector<Packet> packets = read_all(**source);
  CHECK(count_port(packets, 2368, kDataPacketSize) == 1902);
  CHECK(count_port(packets, 8308, kPositionPacketSize) == 367);
  ScanAssembler assembler(make_velodyne_sensor(VelodyneModel::kVlp16), {});
  const std::vector<core::Scan> scans = nilio::tests::assemble(assembler, packets);
  CHECK(scans.size() + assembler.stats().partial_scans >= 50);
  CHECK(scans.size() >= 48);
}

TEST_CASE("every real capture is recognised and decoded without loss", "[captures]") {
  struct Fact {
    const char* file;
    VelodyneModel model;
    ReturnMode mode;
    std::size_t data_packets;
    double revolutions_per_minute;
  };
  const std::array<Fact, 8> facts{{
      {"hdl32e_highway_moving.pcap", VelodyneModel::kHdl32e, ReturnMode::kSingle, 876, 700.0},
      {"hdl32e_monterey_stationary.pcap", VelodyneModel::kHdl32e, ReturnMode::kSingle, 2702, 720.0},
      {"vlp16_gps_stationary.pcap", VelodyneModel::kVlp16, ReturnMode::kSingle, 293, 600.0},
      {"vlp16_preproduction_20hz_50rev.pcap", VelodyneModel::kVlp16, ReturnMode::kSingle, 1902, 1200.0},
      {"vlp16_short.pcap", VelodyneModel::kVlp16, ReturnMode::kSingle, 84, 600.0},
      {"golden/vlp16.pcap", VelodyneModel::kVlp16, ReturnMode::kDual, 603, 600.0},
      {"golden/vlp32.pcap", VelodyneModel::kVlp32c, ReturnMode::kSingle, 379, 600.0},
      {"golden/vls128.pcap", VelodyneModel::kVls128, ReturnMode::kSingle, 2193, 600.0},
  }};
  for (const Fact& fact : facts) {
    NILIO_REQUIRE_DATA(path, std::string("velodyne/") + fact.file);
    INFO(fact.file);
    auto source = open_pcap(path.string(), {});
    REQUIRE(source.ok());
    const std::vector<Packet> packets = read_all(**source);
    const VelodyneDetection detection = detect_velodyne(packets);
    INFO(detection.evidence);
    CHECK(detection.model == fact.model);
    CHECK(detection.mode == fact.mode);
    ScanAssembler assembler(make_velodyne_sensor(fact.model), {.min_coverage = 0.0});
    nilio::tests::assemble(assembler, packets);
    assembler.finish();
    const ScanAssemblerStats& stats = assembler.stats();
    CHECK(stats.packets == fact.data_packets);
    CHECK(stats.lost_packets == 0);
    CHECK(stats.firings_bad == 0);
    CHECK(stats.time_jumps + stats.host_clock_jumps + stats.duplicate_packets + stats.late_packets == 0);
    CHECK(stats.firings == stats.firings_in_scans + stats.firings_discarded);
    CHECK(assembler.status().mode == fact.mode);
    CHECK(assembler.status().revolutions_per_minute == Approx(fact.revolutions_per_minute).epsilon(0.03));
  }
}
