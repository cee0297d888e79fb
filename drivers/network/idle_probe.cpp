#include "drivers/network/idle_probe.hpp"

#include "nilio/drivers/velodyne/model.hpp"

#include "drivers/common/byte_order.hpp"
#include "drivers/common/socket.hpp"
#include "drivers/network/interfaces.hpp"

#include <arpa/inet.h>
#include <cerrno>
#include <cstring>
#include <linux/filter.h>
#include <linux/if_ether.h>
#include <linux/if_packet.h>
#include <sys/socket.h>

namespace nilio::drivers {
namespace {

constexpr std::uint32_t kLongestHeaders = 60 + kUdpHeader;
/// Bounds the time of one call in the receive thread.
constexpr int kPacketsPerCall = 256;
constexpr std::uint8_t kProtocolUdp = 17;

/// Accepts the headers of unfragmented UDP packets with a payload of 1206 or 512 bytes; the data begins at
/// the IP header.
std::array<sock_filter, 11> make_filter() {
  constexpr std::uint8_t kDrop = 10;
  const auto statement = [](int code, std::size_t k) {
    return sock_filter{static_cast<std::uint16_t>(code), 0, 0, static_cast<std::uint32_t>(k)};
  };
  const auto jump = [](int code, std::size_t k, int yes, int no) {
    return sock_filter{static_cast<std::uint16_t>(BPF_JMP | code | BPF_K), static_cast<std::uint8_t>(yes),
                       static_cast<std::uint8_t>(no), static_cast<std::uint32_t>(k)};
  };
  return {statement(BPF_LD | BPF_B | BPF_ABS, 9),
          jump(BPF_JEQ, kProtocolUdp, 0, kDrop - 2),
          statement(BPF_LD | BPF_H | BPF_ABS, 6),
          jump(BPF_JSET, 0x3FFF, kDrop - 4, 0),
          statement(BPF_LDX | BPF_B | BPF_MSH, 0),
          statement(BPF_LD | BPF_H | BPF_IND, 4),
          jump(BPF_JEQ, kDataPacketSize + kUdpHeader, 2, 0),
          jump(BPF_JEQ, kPositionPacketSize + kUdpHeader, 1, 0),
          jump(BPF_JA, 1, 0, 0),
          statement(BPF_RET | BPF_K, kLongestHeaders),
          statement(BPF_RET | BPF_K, 0)};
}

}  // namespace

void IdleProbe::idle(std::int64_t now_ns) {
  if (idle_since_ns_ == 0) idle_since_ns_ = now_ns;
  if (socket_.is_open()) {
    drain();
    if (now_ns - opened_ns_ < timing_.listening.ns) return;
    publish();
    socket_.close();
    closed_ns_ = now_ns;
    return;
  }
  const bool rested = closed_ns_ == 0 || now_ns - closed_ns_ >= timing_.rest.ns;
  if (now_ns - idle_since_ns_ < timing_.patience.ns || !rested) return;
  open();
  opened_ns_ = now_ns;
  // Without the capability the next attempt waits for the rest period, too.
  if (!socket_.is_open()) closed_ns_ = now_ns;
}

void IdleProbe::stop() {
  idle_since_ns_ = 0;
  socket_.close();
}

void IdleProbe::open() {
  window_ = {};
  // Protocol 0 receives nothing until bind(), when the filter is in place.
  socket_ = FileDescriptor(::socket(AF_PACKET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  std::array<sock_filter, 11> filter = make_filter();
  const sock_fprog program{.len = static_cast<unsigned short>(filter.size()), .filter = filter.data()};
  sockaddr_ll all{};
  all.sll_family = AF_PACKET;
  all.sll_protocol = htons(ETH_P_IP);
  const bool good = socket_.is_open() &&
                    setsockopt(socket_.get(), SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof(program)) == 0 &&
                    bind(socket_.get(), reinterpret_cast<const sockaddr*>(&all), sizeof(all)) == 0;
  open_error_.store(good ? 0 : errno, std::memory_order_relaxed);
  if (!good) socket_.close();
}

void IdleProbe::drain() {
  std::array<std::uint8_t, kLongestHeaders> bytes{};
  for (int i = 0; i < kPacketsPerCall; ++i) {
    const ssize_t received = recv(socket_.get(), bytes.data(), bytes.size(), 0);
    if (received < 0) return;
    const std::size_t header = 4U * (bytes[0] & 0x0FU);
    if (static_cast<std::size_t>(received) < header + kUdpHeader) continue;
    const std::uint8_t* udp = bytes.data() + header;
    note({.source = load_be32(bytes.data() + 12),
          .destination = load_be32(bytes.data() + 16),
          .port = load_be16(udp + 2),
          .size = static_cast<std::uint16_t>(load_be16(udp + 4) - kUdpHeader)});
  }
}

void IdleProbe::note(const Stream& stream) {
  for (Window& entry : window_) {
    if (entry.count > 0 && entry.stream != stream) continue;
    entry.stream = stream;
    ++entry.count;
    return;
  }
}

void IdleProbe::publish() {
  for (std::size_t i = 0; i < kStreams; ++i) {
    const Stream& stream = window_[i].stream;
    published_[i].addresses.store((std::uint64_t{stream.source} << 32) | stream.destination,
                                  std::memory_order_relaxed);
    published_[i].port_and_size.store((std::uint32_t{stream.port} << 16) | stream.size,
                                      std::memory_order_relaxed);
    published_[i].count.store(window_[i].count, std::memory_order_relaxed);
  }
  listenings_.fetch_add(1, std::memory_order_release);
}

std::string IdleProbe::describe(std::uint16_t port) const {
  if (const int error = open_error_.load(std::memory_order_relaxed); error != 0) {
    return "traffic on other ports is not visible (" + std::string(std::strerror(error)) +
           "): it needs the capability CAP_NET_RAW";
  }
  if (listenings_.load(std::memory_order_acquire) == 0) return {};
  std::string seen;
  bool own_port = false;
  for (const Published& entry : published_) {
    const std::uint64_t count = entry.count.load(std::memory_order_relaxed);
    if (count == 0) continue;
    const std::uint64_t addresses = entry.addresses.load(std::memory_order_relaxed);
    const std::uint32_t port_and_size = entry.port_and_size.load(std::memory_order_relaxed);
    own_port = own_port || port_and_size >> 16 == port;
    seen += (seen.empty() ? "" : ", ") + std::to_string(count) + " of " +
            std::to_string(port_and_size & 0xFFFF) + " bytes from " +
            format_ipv4(static_cast<std::uint32_t>(addresses >> 32)) + " to " +
            format_ipv4(static_cast<std::uint32_t>(addresses)) + ":" + std::to_string(port_and_size >> 16);
  }
  if (seen.empty()) return "no packets of Velodyne's sizes reach this computer on any port";
  return "on the wire within " + std::to_string(timing_.listening.ns / 1'000'000) + " ms: " + seen +
         (own_port ? "; packets to this port are blocked by a firewall or by "
                     "net.ipv4.conf.*.rp_filter, or are addressed to another computer"
                   : "; set the LiDAR's port to the one that the sensor sends to");
}

}  // namespace nilio::drivers
