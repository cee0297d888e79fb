#include "nilio/drivers/udp.hpp"

#include "drivers_support.hpp"

#include <arpa/inet.h>
#include <ctime>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using Catch::Matchers::Contains;

namespace {

class Sender {
 public:
  Sender() : socket_(socket(AF_INET, SOCK_DGRAM, 0)) {
    address_.sin_family = AF_INET;
    address_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  }
  Sender(const Sender&) = delete;
  Sender& operator=(const Sender&) = delete;
  ~Sender() { close(socket_); }

  void send(std::uint16_t port, const std::vector<std::uint8_t>& payload) {
    address_.sin_port = htons(port);
    REQUIRE(sendto(socket_, payload.data(), payload.size(), 0, reinterpret_cast<const sockaddr*>(&address_),
                   sizeof(address_)) == static_cast<ssize_t>(payload.size()));
  }

  /// A port that was free a moment ago.
  static std::uint16_t free_port() {
    const int probe = socket(AF_INET, SOCK_DGRAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t length = sizeof(address);
    REQUIRE(bind(probe, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0);
    REQUIRE(getsockname(probe, reinterpret_cast<sockaddr*>(&address), &length) == 0);
    close(probe);
    return ntohs(address.sin_port);
  }

 private:
  int socket_;
  sockaddr_in address_{};
};

std::int64_t realtime_ns() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

UdpSourceConfig loopback(std::uint16_t port) {
  return {.bind_address = "127.0.0.1", .port = port, .sender_address = {}};
}

constexpr core::Duration kSecond{1'000'000'000};

}  // namespace

TEST_CASE("datagrams arrive over loopback in order with kernel stamps") {
  const std::uint16_t port = Sender::free_port();
  auto source = open_udp(loopback(port));
  REQUIRE(source.ok());
  Sender sender;
  const std::int64_t before = realtime_ns();
  for (std::uint8_t i = 0; i < 100; ++i) sender.send(port, std::vector<std::uint8_t>(1206, i));
  sender.send(port, {});
  sender.send(port, std::vector<std::uint8_t>(3000, 1));
  std::vector<Packet> packets;
  std::array<Packet, 70> slots;
  while (packets.size() < 102) {
    const SourceRead result = (*source)->read(slots, kSecond);
    REQUIRE(result.state == SourceState::kData);
    packets.insert(packets.end(), slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(result.count));
  }
  for (std::size_t i = 0; i < 100; ++i) {
    CHECK(packets[i].size == 1206);
    CHECK(packets[i].data[1205] == i);
    CHECK(packets[i].sender_address == 0x7F000001);
    CHECK(packets[i].destination_port == port);
    CHECK(packets[i].stamp.ns >= before);
    CHECK(packets[i].stamp.ns <= realtime_ns());
    CHECK(packets[i].received_ns > 0);
  }
  CHECK(packets[100].size == 0);
  CHECK(packets[101].truncated);
  CHECK((*source)->stats().delivered == 102);
  CHECK((*source)->stats().kernel_dropped == 0);
}

TEST_CASE("a silent port is idle after the timeout and says what to check") {
  auto source = open_udp(loopback(Sender::free_port()));
  REQUIRE(source.ok());
  std::array<Packet, 4> slots;
  const std::int64_t before = realtime_ns();
  CHECK((*source)->read(slots, {20'000'000}).state == SourceState::kIdle);
  CHECK(realtime_ns() - before >= 19'000'000);
  CHECK_THAT((*source)->status(), Contains("nothing arrives") && Contains("receive buffer"));
}

TEST_CASE("datagrams of other senders are ignored, counted and named") {
  const std::uint16_t port = Sender::free_port();
  UdpSourceConfig config = loopback(port);
  config.sender_address = "192.168.1.201";
  auto source = open_udp(config);
  REQUIRE(source.ok());
  Sender sender;
  sender.send(port, {1, 2, 3});
  std::array<Packet, 4> slots;
  CHECK((*source)->read(slots, kSecond).state == SourceState::kIdle);
  CHECK((*source)->stats().other == 1);
  CHECK_THAT((*source)->status(), Contains("127.0.0.1") && Contains("192.168.1.201"));
}

TEST_CASE("what overflows the socket's buffer is counted as the kernel counts it") {
  const std::uint16_t port = Sender::free_port();
  UdpSourceConfig config = loopback(port);
  config.receive_buffer_bytes = 4096;
  auto source = open_udp(config);
  REQUIRE(source.ok());
  Sender sender;
  for (int i = 0; i < 50; ++i) sender.send(port, std::vector<std::uint8_t>(1206));
  std::array<Packet, 64> slots;
  std::size_t received = (*source)->read(slots, kSecond).count;
  CHECK(received < 50);
  sender.send(port, {1});
  received += (*source)->read(slots, kSecond).count;
  CHECK((*source)->stats().kernel_dropped == 51 - received);
}

TEST_CASE("a receive buffer that was not granted names the setting that allows it") {
  UdpSourceConfig config = loopback(Sender::free_port());
  config.receive_buffer_bytes = 1 << 30;
  auto source = open_udp(config);
  REQUIRE(source.ok());
  const std::string status = (*source)->status();
  const bool granted = status.find("receive buffer 1048576 KiB,") != std::string::npos ||
                       status.find("receive buffer 1048576 KiB;") != std::string::npos;
  if (!granted) CHECK_THAT(status, Contains("net.core.rmem_max=1073741824"));
}

TEST_CASE("an address that cannot be listened on is named with the reason") {
  const std::uint16_t port = Sender::free_port();
  auto first = open_udp(loopback(port));
  REQUIRE(first.ok());
  const auto second = open_udp(loopback(port));
  REQUIRE_FALSE(second.ok());
  CHECK_THAT(second.error().message,
             Contains("127.0.0.1:" + std::to_string(port)) && Contains("another program"));
  const auto foreign = open_udp({.bind_address = "203.0.113.7", .port = port, .sender_address = {}});
  REQUIRE_FALSE(foreign.ok());
  CHECK_THAT(foreign.error().message, Contains("203.0.113.7") && Contains("ip -4 address"));
  const auto broken = open_udp({.bind_address = "lidar", .port = port, .sender_address = {}});
  REQUIRE_FALSE(broken.ok());
  CHECK_THAT(broken.error().message, Contains("'lidar' is no IPv4 address"));
}
