// Counts calls of operator new. Excluded with sanitizers, which replace it, too.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

#include "tests/support/capture_bytes.hpp"
#include "tests/support/disturbed_packets.hpp"
#include "tests/support/drivers_support.hpp"
#include "tests/support/pcap_support.hpp"
#include "tests/support/udp_support.hpp"

#include <array>
#include <cstdlib>
#include <new>

#include <catch2/catch.hpp>

namespace {

thread_local std::size_t allocations = 0;

}  // namespace

void* operator new(std::size_t size) {
  ++allocations;
  if (void* memory = std::malloc(size == 0 ? 1 : size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t /*size*/) noexcept { std::free(memory); }

using namespace nilio;
using namespace nilio::drivers;
using namespace nilio::tests;

TEST_CASE("a UDP source does not allocate when it reads, waits or ignores", "[allocation]") {
  const auto ports = free_ports(2);
  UdpSourceConfig config = loopback(ports[0], ports[1]);
  config.sender_address = "127.0.0.3";
  auto source = open_udp(config);
  REQUIRE(source.ok());
  UdpSender sensor("127.0.0.3");
  UdpSender other("127.0.0.4");
  const std::vector<std::uint8_t> payload(1206);
  std::array<Packet, 8> slots;
  std::size_t received = 0;
  std::size_t allocated = 0;
  REQUIRE(allocations > 0);
  for (int i = 0; i < 50; ++i) {
    sensor.send(ports[0], payload);
    sensor.send(ports[1], payload);
    other.send(ports[0], payload);
    const std::size_t before = allocations;
    for (int read = 0; read < 3; ++read) received += (*source)->read(slots, {1'000'000}).count;
    allocated += allocations - before;
  }
  CHECK(received == 100);
  CHECK((*source)->stats().other == 50);
  CHECK(allocated == 0);
}

TEST_CASE("a capture is read without allocation after the first packet", "[allocation]") {
  const std::string frame = link_frame(kLinkEthernet, ipv4_udp(2368, std::string(1206, 'x')));
  PcapText classic(kLinkEthernet);
  PcapngText next_generation;
  next_generation.interface(kLinkEthernet);
  for (int i = 0; i < 50; ++i) {
    classic.packet(i, frame).packet(i, link_frame(kLinkEthernet, ipv4_udp(53, "name")));
    next_generation.packet(0, 1, frame).block(5, "statistics..").interface(kLinkRaw);
  }
  for (const std::string& bytes : {classic.bytes(), next_generation.bytes()}) {
    const TemporaryFile file(bytes, ".pcap");
    auto source = open_pcap(file.path(), {});
    REQUIRE(source.ok());
    std::array<Packet, 4> slots;
    REQUIRE((*source)->read(std::span(slots).first(1), {}).count == 1);
    const std::size_t before = allocations;
    std::size_t received = 1;
    while (const std::size_t count = (*source)->read(slots, {}).count) received += count;
    const std::size_t allocated = allocations - before;
    CHECK(received == 50);
    CHECK(allocated == 0);
  }
}

TEST_CASE("lost, copied, reordered and damaged packets are assembled without allocation", "[allocation]") {
  for (const VelodyneModel model :
       {VelodyneModel::kVlp16, VelodyneModel::kHdl64eS1, VelodyneModel::kVls128}) {
    TurningSensor source{.sensor = make_velodyne_sensor(model)};
    std::vector<Packet> packets;
    for (std::size_t i = 0; i < 8000; ++i) {
      // The sensor's clock is set, and single stamps and azimuths are damaged.
      if (i == 5000) source.sensor_ahead_ns += 700'000'000;
      packets.push_back(source.packet(i));
      if (i % 97 == 3) packets.back().data[1203] ^= 0x10U;
      if (i % 89 == 5) packets.back().data[503] ^= 0x20U;
    }
    packets = disturb(packets, {"", 0.2, true, 5}, 1);
    ScanAssembler assembler(source.sensor, {});
    core::Scan scan;
    std::size_t scans = 0;
    std::size_t before = 0;
    for (const Packet& packet : packets) {
      if (!assembler.add(packet)) continue;
      assembler.take_scan(scan);
      // The first scans swap the buffers in.
      if (++scans == 3) before = allocations;
    }
    const std::size_t allocated = allocations - before;
    INFO(source.sensor.name);
    CHECK(scans > 4);
    CHECK(allocated == 0);
  }
}

#endif
