#include "nilio/drivers/network/udp.hpp"

#include "tests/support/udp_support.hpp"

#include <algorithm>
#include <array>
#include <ctime>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using Catch::Matchers::Contains;
using nilio::tests::free_port;
using nilio::tests::free_ports;
using nilio::tests::kSecond;
using nilio::tests::loopback;
using nilio::tests::read_packets;
using nilio::tests::UdpSender;

namespace {

std::int64_t realtime_ns() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

std::vector<std::uint8_t> numbered(std::uint8_t number, std::size_t size = 1206) {
  return std::vector<std::uint8_t>(size, number);
}

}  // namespace

TEST_CASE("datagrams arrive over loopback in order with kernel stamps", "[udp]") {
  const std::uint16_t port = free_port();
  auto source = open_udp(loopback(port));
  REQUIRE(source.ok());
  UdpSender sender;
  const std::int64_t before = realtime_ns();
  for (std::uint8_t i = 0; i < 100; ++i) sender.send(port, numbered(i));
  const std::vector<Packet> packets = read_packets(**source, 100);
  REQUIRE(packets.size() == 100);
  for (std::size_t i = 0; i < 100; ++i) {
    CHECK(packets[i].size == 1206);
    CHECK(packets[i].data[1205] == i);
    CHECK(packets[i].sender_address == 0x7F000001);
    CHECK(packets[i].destination_port == port);
    CHECK(packets[i].stamp.ns >= before);
    CHECK(packets[i].stamp.ns <= realtime_ns());
    CHECK(packets[i].received_ns > 0);
    CHECK_FALSE(packets[i].truncated);
  }
  CHECK((*source)->stats().delivered == 100);
  CHECK((*source)->stats().kernel_dropped == 0);
}

TEST_CASE("empty datagrams are delivered and those longer than a slot are cut and marked", "[udp]") {
  const std::uint16_t port = free_port();
  auto source = open_udp(loopback(port));
  REQUIRE(source.ok());
  UdpSender sender;
  sender.send(port, {});
  sender.send(port, numbered(1, kPacketCapacity));
  sender.send(port, numbered(2, kPacketCapacity + 1));
  sender.send(port, numbered(3, 9000));
  const std::vector<Packet> packets = read_packets(**source, 4);
  REQUIRE(packets.size() == 4);
  CHECK(packets[0].size == 0);
  CHECK_FALSE(packets[0].truncated);
  CHECK(packets[1].size == kPacketCapacity);
  CHECK_FALSE(packets[1].truncated);
  CHECK(packets[2].truncated);
  CHECK(packets[3].truncated);
  CHECK(packets[3].size == kPacketCapacity);
  CHECK_THAT((*source)->status(),
             Contains("1 of 0 bytes") && Contains("1 of 9000 bytes to port " + std::to_string(port)));
}

TEST_CASE("packets of both kinds on one port are a Velodyne's", "[udp]") {
  const std::uint16_t port = free_port();
  auto source = open_udp(loopback(port));
  REQUIRE(source.ok());
  UdpSender sender;
  sender.send(port, numbered(1));
  sender.send(port, numbered(2, 512));
  REQUIRE(read_packets(**source, 2).size() == 2);
  CHECK_THAT((*source)->status(), Contains("2 packets") && !Contains("not a Velodyne's"));
}

TEST_CASE("data and position packets come through one source, each port in its own order", "[udp]") {
  const auto ports = free_ports(2);
  auto source = open_udp(loopback(ports[0], ports[1]));
  REQUIRE(source.ok());
  UdpSender sender;
  for (std::uint8_t i = 0; i < 90; ++i) {
    sender.send(ports[0], numbered(i));
    if (i % 3 == 0) sender.send(ports[1], numbered(i, 512));
  }
  const std::vector<Packet> packets = read_packets(**source, 120);
  REQUIRE(packets.size() == 120);
  std::vector<std::uint8_t> data;
  std::vector<std::uint8_t> position;
  for (const Packet& packet : packets) {
    if (packet.destination_port == ports[0]) {
      CHECK(packet.size == 1206);
      data.push_back(packet.data[0]);
    } else {
      CHECK(packet.destination_port == ports[1]);
      CHECK(packet.size == 512);
      position.push_back(packet.data[0]);
    }
  }
  REQUIRE(data.size() == 90);
  REQUIRE(position.size() == 30);
  for (std::size_t i = 0; i < data.size(); ++i) CHECK(data[i] == i);
  for (std::size_t i = 0; i < position.size(); ++i) CHECK(position[i] == 3 * i);
  CHECK_THAT((*source)->status(), Contains("90 data and 30 position packets"));
}

TEST_CASE("a flood on one port does not starve the other", "[udp]") {
  const auto ports = free_ports(2);
  auto source = open_udp(loopback(ports[0], ports[1]));
  REQUIRE(source.ok());
  UdpSender sender;
  for (int flooded = 0; flooded < 2; ++flooded) {
    const std::uint16_t loud = ports[static_cast<std::size_t>(flooded)];
    const std::uint16_t quiet = ports[static_cast<std::size_t>(1 - flooded)];
    for (int i = 0; i < 20; ++i) sender.send(loud, numbered(0, 512));
    sender.send(quiet, numbered(1, 512));
    std::array<Packet, 4> slots;
    bool received = false;
    for (int read = 0; read < 2; ++read) {
      const std::size_t count = (*source)->read(slots, kSecond).count;
      CHECK(count > 0);
      for (std::size_t i = 0; i < count; ++i) received = received || slots[i].destination_port == quiet;
    }
    CHECK(received);
    CHECK(read_packets(**source, 13).size() == 13);
  }
}

TEST_CASE("two sensors on one port are separated by the sender's address", "[udp]") {
  const std::uint16_t port = free_port();
  UdpSourceConfig config = loopback(port);
  config.sender_address = "127.0.0.3";
  auto source = open_udp(config);
  REQUIRE(source.ok());
  UdpSender wanted("127.0.0.3");
  UdpSender other("127.0.0.4");
  UdpSender third("127.0.0.5");
  for (std::uint8_t i = 0; i < 20; ++i) {
    other.send(port, numbered(100));
    wanted.send(port, numbered(i));
    if (i % 4 == 0) third.send(port, numbered(101));
  }
  const std::vector<Packet> packets = read_packets(**source, 20);
  REQUIRE(packets.size() == 20);
  for (std::size_t i = 0; i < 20; ++i) {
    CHECK(packets[i].data[0] == i);
    CHECK(packets[i].sender_address == 0x7F000003);
  }
  CHECK((*source)->stats().other == 25);
  CHECK_THAT((*source)->status(), Contains("ignored 20 from 127.0.0.4, 5 from 127.0.0.5") &&
                                      Contains("only 127.0.0.3 is accepted"));
}

TEST_CASE(
    "datagrams dropped from the socket's buffer are counted as the kernel counts them, also the last ones",
    "[udp]") {
  const std::uint16_t port = free_port();
  UdpSourceConfig config = loopback(port);
  config.receive_buffer_bytes = 4096;
  auto source = open_udp(config);
  REQUIRE(source.ok());
  UdpSender sender;
  for (std::uint8_t i = 0; i < 50; ++i) sender.send(port, numbered(i));
  // Reads until a second without datagrams: no later datagram carried the count of the drops.
  std::size_t received = read_packets(**source, 50).size();
  REQUIRE(received > 0);
  REQUIRE(received < 50);
  CHECK((*source)->stats().kernel_dropped == 50 - received);
  // A later datagram does not count them again.
  sender.send(port, numbered(50));
  received += read_packets(**source, 1).size();
  CHECK((*source)->stats().kernel_dropped == 51 - received);
  CHECK_THAT((*source)->status(), Contains(std::to_string(51 - received) + " dropped by the kernel"));
}

TEST_CASE("drops on both ports are added up", "[udp]") {
  const auto ports = free_ports(2);
  UdpSourceConfig config = loopback(ports[0], ports[1]);
  config.receive_buffer_bytes = 4096;
  auto source = open_udp(config);
  REQUIRE(source.ok());
  UdpSender sender;
  for (std::uint8_t i = 0; i < 40; ++i) {
    sender.send(ports[0], numbered(i));
    sender.send(ports[1], numbered(i, 512));
  }
  const std::size_t received = read_packets(**source, 80).size();
  CHECK(received < 80);
  CHECK((*source)->stats().kernel_dropped == 80 - received);
}

TEST_CASE("a multicast group is joined and shared between two sources", "[udp]") {
  const auto ports = free_ports(2);
  UdpSourceConfig config = loopback(ports[0], ports[1]);
  config.multicast_group = "239.255.17.42";
  for (const char* interface : {"", "127.0.0.1", "lo"}) {
    config.multicast_interface = interface;
    auto first = open_udp(config);
    auto second = open_udp(config);
    REQUIRE(first.ok());
    REQUIRE(second.ok());
    UdpSender sender;
    REQUIRE(sender.send_through("127.0.0.1"));
    sender.send(ports[0], numbered(1), "239.255.17.42");
    sender.send(ports[1], numbered(2, 512), "239.255.17.42");
    // To the computer, and to another group: members of this group receive neither.
    sender.send(ports[0], numbered(3));
    sender.send(ports[0], numbered(4), "239.255.17.43");
    for (auto* source : {&first, &second}) {
      CHECK(read_packets(***source, 2).size() == 2);
      std::array<Packet, 4> slots;
      CHECK((**source)->read(slots, {10'000'000}).count == 0);
    }
  }
}

TEST_CASE("the error for an invalid multicast group or interface names it", "[udp]") {
  UdpSourceConfig config = loopback(free_port());
  config.multicast_group = "192.168.1.201";
  CHECK_THAT(open_udp(config).error().message, Contains("192.168.1.201 is no multicast group"));
  config.multicast_group = "239.255.17.42";
  config.multicast_interface = "lidar0";
  CHECK_THAT(open_udp(config).error().message, Contains("no interface 'lidar0'"));
  config.multicast_interface = "203.0.113.7";
  CHECK_THAT(open_udp(config).error().message, Contains("cannot join the multicast group 239.255.17.42"));
}

TEST_CASE("status() names the setting that allows a larger receive buffer", "[udp]") {
  UdpSourceConfig config = loopback(free_port());
  config.receive_buffer_bytes = 1 << 30;
  auto source = open_udp(config);
  REQUIRE(source.ok());
  const std::string status = (*source)->status();
  const bool granted = status.find("receive buffer 1048576 KiB") != std::string::npos;
  if (!granted) CHECK_THAT(status, Contains("net.core.rmem_max=1073741824"));
}

TEST_CASE("the error for an unusable address names it and the reason", "[udp]") {
  const auto ports = free_ports(2);
  auto first = open_udp(loopback(ports[0], ports[1]));
  REQUIRE(first.ok());
  const auto second = open_udp(loopback(ports[0]));
  REQUIRE_FALSE(second.ok());
  CHECK_THAT(second.error().message,
             Contains("127.0.0.1:" + std::to_string(ports[0])) && Contains("another program"));
  const auto third = open_udp(loopback(free_port(), ports[1]));
  REQUIRE_FALSE(third.ok());
  CHECK_THAT(third.error().message,
             Contains("127.0.0.1:" + std::to_string(ports[1])) && Contains("position port of 0"));
  CHECK_THAT(open_udp(loopback(ports[0], ports[0])).error().message, Contains("a port each"));
  const auto foreign = open_udp({.bind_address = "203.0.113.7", .port = free_port(), .position_port = 0});
  REQUIRE_FALSE(foreign.ok());
  CHECK_THAT(foreign.error().message, Contains("203.0.113.7") && Contains("ip -4 address"));
  const auto broken = open_udp({.bind_address = "lidar", .port = free_port(), .position_port = 0});
  REQUIRE_FALSE(broken.ok());
  CHECK_THAT(broken.error().message, Contains("'lidar' is no IPv4 address"));
  UdpSourceConfig config = loopback(free_port());
  config.sender_address = "sensor";
  CHECK_THAT(open_udp(config).error().message, Contains("'sensor' is no IPv4 address for the sender"));
}

TEST_CASE("packets of another program's port are read beside it, with the same bytes and time stamps",
          "[udp]") {
  const std::uint16_t port = free_port();
  auto owner = open_udp(loopback(port));
  REQUIRE(owner.ok());
  UdpSourceConfig config = loopback(port);
  config.position_port = 0;
  auto tap = open_udp_or_tap(config);
  if (!tap) {
    CHECK_THAT(tap.error().message, Contains("CAP_NET_RAW"));
    WARN("skipped: no permission for packet sockets");
    return;
  }
  UdpSender sender;
  for (std::uint8_t i = 0; i < 100; ++i) sender.send(port, numbered(i));
  sender.send(port, numbered(100, 1400));
  sender.send(free_port(), numbered(101));
  const std::vector<Packet> owned = read_packets(**owner, 101);
  const std::vector<Packet> copied = read_packets(**tap, 101);
  REQUIRE(owned.size() == 101);
  REQUIRE(copied.size() == 101);
  for (std::size_t i = 0; i < owned.size(); ++i) {
    CHECK(copied[i].stamp == owned[i].stamp);
    CHECK(copied[i].size == owned[i].size);
    CHECK(copied[i].truncated == owned[i].truncated);
    CHECK(copied[i].sender_address == owned[i].sender_address);
    CHECK(copied[i].sender_port == owned[i].sender_port);
    CHECK(copied[i].destination_port == port);
    CHECK(std::equal(copied[i].data.begin(), copied[i].data.begin() + copied[i].size, owned[i].data.begin()));
  }
  CHECK((*tap)->stats().kernel_dropped == 0);
  CHECK_THAT((*tap)->status(), Contains("beside another program: 101 packets"));
}
