#include "nilio/drivers/pcap.hpp"

#include "../unit/drivers_support.hpp"
#include "../unit/test_data.hpp"

#include <cmath>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;

namespace {

std::vector<Packet> read_all(PacketSource& source) {
  std::vector<Packet> packets;
  std::vector<Packet> slots(32);
  for (;;) {
    const SourceRead result = source.read(slots, core::Duration{});
    if (result.state != SourceState::kData) break;
    packets.insert(packets.end(), slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(result.count));
  }
  return packets;
}

std::size_t count_port(const std::vector<Packet>& packets, std::uint16_t port, std::size_t size) {
  return static_cast<std::size_t>(std::count_if(packets.begin(), packets.end(), [&](const Packet& packet) {
    return packet.destination_port == port && packet.size == size;
  }));
}

}  // namespace

TEST_CASE("a short VLP-16 capture is read whole and recognised") {
  NILIO_REQUIRE_DATA(path, "velodyne/vlp16_short.pcap");
  auto source = open_pcap(path.string(), {});
  REQUIRE(source.ok());
  const std::vector<Packet> packets = read_all(**source);
  CHECK(count_port(packets, 2368, kDataPacketSize) == 84);
  CHECK(count_port(packets, 8308, kPositionPacketSize) == 16);
  CHECK((*source)->stats().delivered == 100);
  CHECK((*source)->stats().malformed == 0);
  // Its product byte says HDL-32E; its packet period does not.
  CHECK(detect_velodyne_model(packets) == VelodyneModel::kVlp16);
}

TEST_CASE("sensors that are not supported are not taken for one that is") {
  for (const char* name : {"velodyne/hdl32e_monterey_stationary.pcap", "velodyne/golden/vlp32.pcap",
                           "velodyne/golden/vls128.pcap"}) {
    const auto path = nilio::tests::find_data(name);
    if (!path) {
      WARN("skipped: no data");
      return;
    }
    auto source = open_pcap(path->string(), {});
    REQUIRE(source.ok());
    const std::vector<Packet> packets = read_all(**source);
    REQUIRE(packets.size() > 300);
    CHECK_FALSE(detect_velodyne_model(packets).has_value());
  }
}

TEST_CASE("a VLP-16 capture gives whole revolutions of plausible points") {
  NILIO_REQUIRE_DATA(path, "velodyne/vlp16_gps_stationary.pcap");
  auto source = open_pcap(path.string(), {});
  REQUIRE(source.ok());
  const std::vector<Packet> packets = read_all(**source);
  CHECK(count_port(packets, 2368, kDataPacketSize) == 293);
  CHECK(count_port(packets, 8308, kPositionPacketSize) == 57);
  ScanAssembler assembler(make_velodyne_sensor(VelodyneModel::kVlp16), {});
  const std::vector<core::Scan> scans = nilio::tests::assemble(assembler, packets);
  CHECK(detect_velodyne_model(packets) == VelodyneModel::kVlp16);
  CHECK(assembler.stats().packets == 293);
  CHECK(assembler.stats().bad_block == 0);
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

TEST_CASE("a capture whose IP lengths are wrong is read by its UDP lengths") {
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

TEST_CASE("dual-return packets of a real sensor are counted and not decoded") {
  NILIO_REQUIRE_DATA(path, "velodyne/golden/vlp16.pcap");
  auto source = open_pcap(path.string(), {});
  REQUIRE(source.ok());
  ScanAssembler assembler(make_velodyne_sensor(VelodyneModel::kVlp16), {});
  CHECK(nilio::tests::assemble(assembler, read_all(**source)).empty());
  CHECK(assembler.stats().dual_return == 603);
}
