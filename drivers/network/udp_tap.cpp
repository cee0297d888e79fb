#include "nilio/core/clock.hpp"
#include "nilio/drivers/capture/capture_reader.hpp"
#include "nilio/drivers/network/udp.hpp"

#include "drivers/common/counters.hpp"
#include "drivers/common/socket.hpp"
#include "drivers/network/interfaces.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <linux/filter.h>
#include <linux/if_ether.h>
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

constexpr std::size_t kLongestIpHeader = 60;
constexpr std::uint8_t kProtocolUdp = 17;

/// Accepts unfragmented UDP to the port; the data begins at the IP header.
std::array<sock_filter, 9> make_filter(std::uint16_t port) {
  const auto statement = [](int code, std::uint32_t k) {
    return sock_filter{static_cast<std::uint16_t>(code), 0, 0, k};
  };
  const auto jump = [](int code, std::uint32_t k, std::uint8_t yes, std::uint8_t no) {
    return sock_filter{static_cast<std::uint16_t>(BPF_JMP | code | BPF_K), yes, no, k};
  };
  return {statement(BPF_LD | BPF_B | BPF_ABS, 9),
          jump(BPF_JEQ, kProtocolUdp, 0, 6),
          statement(BPF_LD | BPF_H | BPF_ABS, 6),
          jump(BPF_JSET, 0x3FFF, 4, 0),
          statement(BPF_LDX | BPF_B | BPF_MSH, 0),
          statement(BPF_LD | BPF_H | BPF_IND, 2),
          jump(BPF_JEQ, port, 0, 1),
          statement(BPF_RET | BPF_K, 0x40000),
          statement(BPF_RET | BPF_K, 0)};
}

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
  std::array<std::uint8_t, kLongestIpHeader + kUdpHeader + kPacketCapacity> bytes_{};
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
  // Protocol 0 receives nothing until bind(), when the filter is in place.
  FileDescriptor socket(::socket(AF_PACKET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (!socket.is_open())
    return Error{where + "its packets cannot be read beside it (" + std::strerror(errno) +
                 ") - give this program CAP_NET_RAW, or use niliod --record"};
  std::array<sock_filter, 9> filter = make_filter(config.port);
  const sock_fprog program{.len = static_cast<unsigned short>(filter.size()), .filter = filter.data()};
  sockaddr_ll all{};
  all.sll_family = AF_PACKET;
  all.sll_protocol = htons(ETH_P_IP);
  const std::optional<int> buffer = request_receive_buffer(socket.get(), config.receive_buffer_bytes);
  if (!buffer || !set_socket_option(socket.get(), SOL_SOCKET, SO_TIMESTAMPNS, 1) ||
      !set_socket_option(socket.get(), SOL_SOCKET, SO_RXQ_OVFL, 1) ||
      !set_socket_option(socket.get(), SOL_SOCKET, SO_ATTACH_FILTER, program) ||
      bind(socket.get(), reinterpret_cast<const sockaddr*>(&all), sizeof(all)) != 0)
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
