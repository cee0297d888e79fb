#include "drivers/network/idle_probe.hpp"
#include "drivers/network/interfaces.hpp"
#include "tests/support/udp_support.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using Catch::Matchers::Contains;
using nilio::tests::free_port;
using nilio::tests::free_ports;
using nilio::tests::loopback;
using nilio::tests::read_packets;
using nilio::tests::UdpSender;

namespace {

constexpr std::int64_t kMillisecondNs = 1'000'000;

bool can_listen_below_sockets() {
  const int descriptor = socket(AF_PACKET, SOCK_DGRAM, 0);
  if (descriptor >= 0) close(descriptor);
  return descriptor >= 0;
}

/// An interface in a simulated sysfs.
class FakeSysfs {
 public:
  FakeSysfs() : root_(std::filesystem::temp_directory_path() / ("nilio_sysfs_" + std::to_string(getpid()))) {}
  FakeSysfs(const FakeSysfs&) = delete;
  FakeSysfs& operator=(const FakeSysfs&) = delete;
  ~FakeSysfs() { std::filesystem::remove_all(root_); }

  void set(const std::string& interface, const std::string& file, const std::string& content) const {
    std::filesystem::create_directories(root_ / interface);
    std::ofstream(root_ / interface / file) << content << '\n';
  }
  [[nodiscard]] const std::filesystem::path& root() const { return root_; }

 private:
  std::filesystem::path root_;
};

}  // namespace

TEST_CASE("a silent port is idle after the timeout and status() names the checks", "[udp_status]") {
  auto source = open_udp(loopback(free_port()));
  REQUIRE(source.ok());
  CHECK_THAT((*source)->status(), !Contains("nothing arrives"));
  std::array<Packet, 4> slots;
  CHECK((*source)->read(slots, {20 * kMillisecondNs}).state == SourceState::kIdle);
  CHECK_THAT((*source)->status(), Contains("nothing arrives") && Contains("receive buffer") &&
                                      Contains("lo (127.0.0.1/8): link up"));
}

TEST_CASE("status() names the port to check when only position packets arrive", "[udp_status]") {
  const auto ports = free_ports(2);
  auto source = open_udp(loopback(ports[0], ports[1]));
  REQUIRE(source.ok());
  UdpSender sender;
  for (int i = 0; i < 3; ++i) sender.send(ports[1], std::vector<std::uint8_t>(512));
  CHECK(read_packets(**source, 3).size() == 3);
  CHECK_THAT((*source)->status(), Contains("0 data and 3 position packets, the last ") &&
                                      Contains("position packets arrive, data does not"));
  sender.send(ports[0], std::vector<std::uint8_t>(1206));
  CHECK(read_packets(**source, 1).size() == 1);
  CHECK_THAT((*source)->status(), Contains("1 data and 3 position packets") && !Contains("data does not"));
}

TEST_CASE("status() warns of packets of several sensors without a filter", "[udp_status]") {
  const std::uint16_t port = free_port();
  auto source = open_udp(loopback(port));
  REQUIRE(source.ok());
  UdpSender first("127.0.0.3");
  UdpSender second("127.0.0.4");
  first.send(port, std::vector<std::uint8_t>(1206));
  CHECK(read_packets(**source, 1).size() == 1);
  CHECK_THAT((*source)->status(), !Contains("several sensors"));
  second.send(port, std::vector<std::uint8_t>(1206));
  second.send(port, std::vector<std::uint8_t>(1206));
  CHECK(read_packets(**source, 2).size() == 2);
  CHECK_THAT((*source)->status(),
             Contains("several sensors") && Contains("2 from 127.0.0.4, 1 from 127.0.0.3"));
}

TEST_CASE("senders beyond the capacity are counted together", "[udp_status]") {
  const std::uint16_t port = free_port();
  UdpSourceConfig config = loopback(port);
  config.sender_address = "127.0.0.1";
  auto source = open_udp(config);
  REQUIRE(source.ok());
  for (int i = 2; i < 14; ++i) {
    UdpSender sender(("127.0.0." + std::to_string(i)).c_str());
    sender.send(port, std::vector<std::uint8_t>(1206));
  }
  std::array<Packet, 64> slots;
  CHECK((*source)->read(slots, nilio::tests::kSecond).count == 0);
  CHECK((*source)->stats().other == 12);
  CHECK_THAT((*source)->status(), Contains("1 from 127.0.0.9, and 4 others"));
}

TEST_CASE("the status is read by another thread while packets arrive", "[udp_status]") {
  const std::uint16_t port = free_port();
  auto source = open_udp(loopback(port));
  REQUIRE(source.ok());
  std::atomic<bool> stop{false};
  std::size_t longest = 0;
  std::thread reader([&] {
    do {
      longest = std::max(longest, (*source)->status().size());
    } while (!stop.load());
  });
  std::size_t received = 0;
  for (int round = 0; round < 20; ++round) {
    for (int last = 2; last < 8; ++last) {
      UdpSender sender(("127.0.0." + std::to_string(last)).c_str());
      sender.send(port, std::vector<std::uint8_t>(static_cast<std::size_t>(round)));
    }
    received += read_packets(**source, 6).size();
  }
  stop.store(true);
  reader.join();
  CHECK(received == 120);
  CHECK(longest > 0);
}

TEST_CASE("a link's state is described with the remedy", "[udp_status]") {
  const FakeSysfs sysfs;
  sysfs.set("eth0", "operstate", "up");
  sysfs.set("eth0", "carrier", "1");
  sysfs.set("eth1", "operstate", "down");
  sysfs.set("eth1", "carrier", "0");
  sysfs.set("eth2", "operstate", "down");
  sysfs.set("lo", "operstate", "unknown");
  sysfs.set("lo", "carrier", "1");
  CHECK(describe_link("eth0", sysfs.root()) == "link up");
  CHECK_THAT(describe_link("eth1", sysfs.root()), Contains("no link: check the cable"));
  CHECK_THAT(describe_link("eth2", sysfs.root()), Contains("ip link set eth2 up"));
  CHECK(describe_link("lo", sysfs.root()) == "link up");
  CHECK(describe_link("eth9", sysfs.root()) == "state unknown");
}

TEST_CASE("interfaces are found by address and by name", "[udp_status]") {
  CHECK_THAT(describe_interfaces("127.0.0.1"), Contains("lo (127.0.0.1/8"));
  CHECK_THAT(describe_interfaces("lo"), Contains("lo (127.0.0.1/8"));
  CHECK_THAT(describe_interfaces("203.0.113.7"), Contains("no interface has 203.0.113.7"));
  CHECK_THAT(describe_interfaces("0.0.0.0"), !Contains("lo ("));
}

TEST_CASE("the idle probe sees only Velodyne's packets to other ports", "[udp_status]") {
  if (!can_listen_below_sockets()) {
    IdleProbe probe({.patience = {0}, .listening = {0}, .rest = {0}});
    probe.idle(1);
    CHECK_THAT(probe.describe(2368), Contains("CAP_NET_RAW"));
    WARN("skipped in part: no CAP_NET_RAW");
    return;
  }
  IdleProbe probe({.patience = {10}, .listening = {10}, .rest = {100}});
  const auto ports = free_ports(2);
  UdpSender sender("127.0.0.9");
  probe.idle(1);
  CHECK_FALSE(probe.is_listening());
  probe.idle(11);
  CHECK(probe.is_listening());
  CHECK(probe.describe(2368).empty());
  for (int i = 0; i < 5; ++i) sender.send(ports[0], std::vector<std::uint8_t>(1206), "127.0.0.2");
  sender.send(ports[1], std::vector<std::uint8_t>(512), "127.0.0.2");
  sender.send(ports[1], std::vector<std::uint8_t>(1205), "127.0.0.2");
  probe.idle(21);
  CHECK_FALSE(probe.is_listening());
  const std::string seen = probe.describe(2368);
  CHECK_THAT(seen, Contains("5 of 1206 bytes from 127.0.0.9 to 127.0.0.2:" + std::to_string(ports[0])) &&
                       Contains("1 of 512 bytes from 127.0.0.9 to 127.0.0.2:" + std::to_string(ports[1])) &&
                       Contains("set the LiDAR's port") && !Contains("1205 bytes"));
  CHECK_THAT(probe.describe(ports[0]), Contains("firewall"));
  SECTION("it pauses before it listens again") {
    probe.idle(120);
    CHECK_FALSE(probe.is_listening());
    probe.idle(121);
    CHECK(probe.is_listening());
    probe.idle(131);
    CHECK_THAT(probe.describe(2368), !Contains("127.0.0.9"));
  }
  SECTION("packets seen while data arrives are not reported") {
    probe.idle(121);
    sender.send(ports[1], std::vector<std::uint8_t>(1206));
    probe.stop();
    CHECK_FALSE(probe.is_listening());
    CHECK(probe.describe(2368) == seen);
  }
}

TEST_CASE("an idle source detects a sensor that sends to another port", "[udp_status]") {
  if (!can_listen_below_sockets()) {
    WARN("skipped: no CAP_NET_RAW");
    return;
  }
  const auto ports = free_ports(2);
  auto source = open_udp(loopback(ports[0]));
  REQUIRE(source.ok());
  UdpSender sender("127.0.0.9");
  std::array<Packet, 4> slots;
  const std::string wanted = "from 127.0.0.9 to 127.0.0.1:" + std::to_string(ports[1]);
  bool found = false;
  for (int i = 0; i < 2000 && !found; ++i) {
    sender.send(ports[1], std::vector<std::uint8_t>(1206));
    CHECK((*source)->read(slots, {20 * kMillisecondNs}).state == SourceState::kIdle);
    found = (*source)->status().find(wanted) != std::string::npos;
  }
  CHECK(found);
}

TEST_CASE("a sensor whose data goes to another port is found while its position packets arrive",
          "[udp_status]") {
  if (!can_listen_below_sockets()) {
    WARN("skipped: no CAP_NET_RAW");
    return;
  }
  const auto ports = free_ports(3);
  auto source = open_udp(loopback(ports[0], ports[1]));
  REQUIRE(source.ok());
  UdpSender sender("127.0.0.9");
  std::array<Packet, 4> slots;
  const std::string wanted = "from 127.0.0.9 to 127.0.0.1:" + std::to_string(ports[2]);
  const auto start = std::chrono::steady_clock::now();
  const auto seconds = [&] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  bool found = false;
  while (!found && seconds() < 10.0) {
    sender.send(ports[1], std::vector<std::uint8_t>(512));
    sender.send(ports[2], std::vector<std::uint8_t>(1206));
    CHECK((*source)->read(slots, {20 * kMillisecondNs}).count == 1);
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    found = (*source)->status().find(wanted) != std::string::npos;
  }
  CHECK(found);
  // Within the two seconds after which niliod reports silence.
  CHECK(seconds() < 2.0);
  CHECK_THAT((*source)->status(), Contains("position packets arrive, data does not") &&
                                      Contains("set the LiDAR's port") && !Contains("nothing arrives"));
}
