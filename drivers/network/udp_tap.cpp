#include "nilio/core/clock.hpp"
#include "nilio/drivers/capture/capture_reader.hpp"
#include "nilio/drivers/network/udp.hpp"

#include "drivers/common/counters.hpp"
#include "drivers/common/socket.hpp"
#include "drivers/network/interfaces.hpp"
#include "drivers/network/sockets.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <linux/if_packet.h>
#include <netinet/in.h>
#include <poll.h>
#include <span>
#include <sys/socket.h>
#include <utility>

#include <pcap/dlt.h>

namespace nilio::drivers {
namespace {

using core::Error;
using core::Result;

// An IP header has up to 60 bytes.
constexpr std::size_t kLongestDatagram = 60 + kUdpHeader + kPacketCapacity;

/// Copies of the datagrams that this computer receives for a port of another program.
class UdpTap final : public PacketSource {
 public:
  UdpTap(FileDescriptor socket, UdpSourceConfig config, std::uint32_t accepted_sender, int buffer_bytes)
      : socket_(std::move(socket)),
        config_(std::move(config)),
        accepted_sender_(accepted_sender),
        buffer_text_(describe_receive_buffer(buffer_bytes, config_.receive_buffer_bytes)) {}

  SourceRead read(std::span<Packet> slots, core::Duration timeout) override;
  [[nodiscard]] SourceStats stats() const override { return counters_.read(); }
  [[nodiscard]] std::string status() const override;

 private:
  enum class Received { kNothing, kOther, kPacket };
  Received receive(Packet& slot);
  bool parse(std::size_t size, Packet& slot);

  FileDescriptor socket_;
  const UdpSourceConfig config_;
  /// Host byte order; 0 = any.
  const std::uint32_t accepted_sender_;
  const std::string buffer_text_;
  SourceCounters counters_;
  std::atomic<int> error_{0};
  std::uint32_t drops_ = 0;
  std::array<std::uint8_t, kLongestDatagram> bytes_{};
};

SourceRead UdpTap::read(std::span<Packet> slots, core::Duration timeout) {
  if (error_.load(std::memory_order_relaxed) != 0) return {SourceState::kFailed, 0};
  pollfd polled{.fd = socket_.get(), .events = POLLIN, .revents = 0};
  const timespec limit = to_timespec(timeout);
  if (ppoll(&polled, 1, &limit, nullptr) <= 0) return {SourceState::kIdle, 0};
  std::size_t count = 0;
  while (count < slots.size()) {
    const Received received = receive(slots[count]);
    if (received == Received::kNothing) break;
    if (received == Received::kPacket) ++count;
  }
  counters_.add_delivered(count);
  if (count > 0) return {SourceState::kData, count};
  return {error_.load(std::memory_order_relaxed) != 0 ? SourceState::kFailed : SourceState::kIdle, 0};
}

UdpTap::Received UdpTap::receive(Packet& slot) {
  iovec buffer{.iov_base = bytes_.data(), .iov_len = bytes_.size()};
  sockaddr_ll link{};
  ControlBuffer control_buffer;
  msghdr message{};
  message.msg_name = &link;
  message.msg_namelen = sizeof(link);
  message.msg_iov = &buffer;
  message.msg_iovlen = 1;
  message.msg_control = control_buffer.bytes.data();
  message.msg_controllen = control_buffer.bytes.size();
  const ssize_t received = recvmsg(socket_.get(), &message, MSG_DONTWAIT);
  if (received < 0) {
    if (errno != EAGAIN && errno != EINTR) error_.store(errno, std::memory_order_relaxed);
    return Received::kNothing;
  }
  const ReceivedControl control = read_control(message);
  if (control.drops) counters_.add_kernel_dropped(*control.drops - std::exchange(drops_, *control.drops));
  slot.stamp = control.stamp;
  slot.received_ns = monotonic_ns();
  // On the loopback interface, every datagram passes twice.
  if (link.sll_pkttype == PACKET_OUTGOING || !parse(static_cast<std::size_t>(received), slot))
    return Received::kOther;
  if (accepted_sender_ != 0 && slot.sender_address != accepted_sender_) {
    counters_.add_other(1);
    return Received::kOther;
  }
  return Received::kPacket;
}

/// False where the bytes are no complete UDP header.
bool UdpTap::parse(std::size_t size, Packet& slot) {
  const CapturedDatagram datagram = find_datagram(DLT_RAW, std::span(bytes_).first(size));
  if (datagram.kind != CapturedDatagram::Kind::kUdp) return false;
  slot.sender_address = datagram.source_address;
  slot.sender_port = datagram.source_port;
  slot.destination_port = datagram.destination_port;
  slot.size = static_cast<std::uint16_t>(std::min(datagram.payload.size(), slot.data.size()));
  slot.truncated = datagram.payload_size > slot.size;
  std::copy_n(datagram.payload.begin(), slot.size, slot.data.begin());
  return true;
}

std::string UdpTap::status() const {
  const SourceStats stats = counters_.read();
  std::string text = "UDP port " + std::to_string(config_.port) + " beside another program: ";
  if (const int error = error_.load(std::memory_order_relaxed); error != 0)
    return text + "receiving failed: " + std::strerror(error) + "; check the network interface";
  text += std::to_string(stats.delivered) + " packets, ";
  if (stats.kernel_dropped > 0) text += std::to_string(stats.kernel_dropped) + " dropped by the kernel, ";
  return text + buffer_text_;
}

Result<std::unique_ptr<PacketSource>> open_tap(const UdpSourceConfig& config) {
  const std::string where = "UDP port " + std::to_string(config.port) + ": another program has it, and ";
  const Result<std::uint32_t> sender = parse_optional_ipv4(config.sender_address, "sender");
  if (!sender) return sender.error();
  FileDescriptor socket = open_packet_socket({.field = DatagramFilter::Field::kDestinationPort,
                                              .values = {config.port, config.port},
                                              .kept_bytes = kLongestDatagram});
  if (!socket.is_open())
    return Error{where + "its packets cannot be read beside it (" + std::strerror(errno) +
                 ") - give this program CAP_NET_RAW, or use niliod --record"};
  const std::optional<int> buffer = request_receive_buffer(socket.get(), config.receive_buffer_bytes);
  if (!buffer || !set_socket_option(socket.get(), SOL_SOCKET, SO_TIMESTAMPNS, 1) ||
      !set_socket_option(socket.get(), SOL_SOCKET, SO_RXQ_OVFL, 1) || !start_packet_socket(socket))
    return Error{where + "its packets cannot be read beside it (" + std::strerror(errno) + ")"};
  return std::unique_ptr<PacketSource>(std::make_unique<UdpTap>(std::move(socket), config, *sender, *buffer));
}

bool is_port_taken(const UdpSourceConfig& config) {
  const FileDescriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  sockaddr_in local{};
  local.sin_family = AF_INET;
  local.sin_port = htons(config.port);
  return bind(socket.get(), reinterpret_cast<const sockaddr*>(&local), sizeof(local)) != 0 &&
         errno == EADDRINUSE;
}

}  // namespace

Result<std::unique_ptr<PacketSource>> open_udp_or_tap(const UdpSourceConfig& config) {
  auto source = open_udp(config);
  return source || !is_port_taken(config) ? std::move(source) : open_tap(config);
}

}  // namespace nilio::drivers
