#pragma once

#include "nilio/drivers/network/udp.hpp"

#include <arpa/inet.h>
#include <cstdint>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>
#include <vector>

#include <catch2/catch.hpp>

namespace nilio::tests {

inline constexpr core::Duration kSecond{1'000'000'000};

/// Sends datagrams from any loopback address (127.x.y.z) to 127.0.0.1 or a group.
class UdpSender {
 public:
  explicit UdpSender(const char* source = "127.0.0.1") : socket_(socket(AF_INET, SOCK_DGRAM, 0)) {
    const sockaddr_in from = address(source, 0);
    REQUIRE(bind(socket_, reinterpret_cast<const sockaddr*>(&from), sizeof(from)) == 0);
  }
  UdpSender(const UdpSender&) = delete;
  UdpSender& operator=(const UdpSender&) = delete;
  ~UdpSender() { close(socket_); }

  void send(std::uint16_t port, const std::vector<std::uint8_t>& payload,
            const char* destination = "127.0.0.1") {
    const sockaddr_in to = address(destination, port);
    REQUIRE(sendto(socket_, payload.data(), payload.size(), 0, reinterpret_cast<const sockaddr*>(&to),
                   sizeof(to)) == static_cast<ssize_t>(payload.size()));
  }

  /// For groups: address of the outgoing interface.
  bool send_through(const char* interface_address) {
    const in_addr interface = address(interface_address, 0).sin_addr;
    return setsockopt(socket_, IPPROTO_IP, IP_MULTICAST_IF, &interface, sizeof(interface)) == 0;
  }

  static sockaddr_in address(const char* text, std::uint16_t port) {
    sockaddr_in result{};
    result.sin_family = AF_INET;
    result.sin_port = htons(port);
    REQUIRE(inet_pton(AF_INET, text, &result.sin_addr) == 1);
    return result;
  }

 private:
  int socket_;
};

/// `count` different ports that were free at the time of the call.
inline std::vector<std::uint16_t> free_ports(std::size_t count) {
  std::vector<int> probes;
  std::vector<std::uint16_t> ports;
  for (std::size_t i = 0; i < count; ++i) {
    probes.push_back(socket(AF_INET, SOCK_DGRAM, 0));
    sockaddr_in address = UdpSender::address("127.0.0.1", 0);
    socklen_t length = sizeof(address);
    REQUIRE(bind(probes.back(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0);
    REQUIRE(getsockname(probes.back(), reinterpret_cast<sockaddr*>(&address), &length) == 0);
    ports.push_back(ntohs(address.sin_port));
  }
  for (const int probe : probes) close(probe);
  return ports;
}

inline std::uint16_t free_port() { return free_ports(1).front(); }

inline drivers::UdpSourceConfig loopback(std::uint16_t port, std::uint16_t position_port = 0) {
  return {.bind_address = "127.0.0.1", .port = port, .position_port = position_port};
}

/// Reads until `count` packets have arrived or a read returns none.
inline std::vector<drivers::Packet> read_packets(drivers::PacketSource& source, std::size_t count) {
  std::vector<drivers::Packet> packets;
  std::vector<drivers::Packet> slots(70);
  while (packets.size() < count) {
    const drivers::SourceRead result = source.read(slots, kSecond);
    if (result.state != drivers::SourceState::kData) break;
    packets.insert(packets.end(), slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(result.count));
  }
  return packets;
}

}  // namespace nilio::tests
