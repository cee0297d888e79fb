#include "drivers/network/idle_probe.hpp"

#include "nilio/drivers/velodyne/model.hpp"

#include "drivers/common/byte_order.hpp"
#include "drivers/common/socket.hpp"
#include "drivers/network/interfaces.hpp"
#include "drivers/network/sockets.hpp"

#include <cerrno>
#include <cstring>
#include <sys/socket.h>

namespace nilio::drivers {
namespace {

constexpr std::uint32_t kLongestHeaders = 60 + kUdpHeader;
/// Bounds the time of one call in the receive thread.
constexpr int kPacketsPerCall = 256;

/// The headers of packets with a payload of 1206 or 512 bytes.
constexpr DatagramFilter kVelodyneSizes{
    .field = DatagramFilter::Field::kLength,
    .values = {kDataPacketSize + kUdpHeader, kPositionPacketSize + kUdpHeader},
    .kept_bytes = kLongestHeaders};

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
  socket_ = open_packet_socket(kVelodyneSizes);
  const bool good = socket_.is_open() && start_packet_socket(socket_);
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
