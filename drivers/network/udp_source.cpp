#include "nilio/drivers/network/udp.hpp"

#include "drivers/can/socketcan/link_state.hpp"
#include "drivers/common/source_support.hpp"
#include "drivers/network/idle_probe.hpp"
#include "drivers/network/ipv4_address.hpp"
#include "drivers/network/udp_sightings.hpp"
#include "drivers/network/udp_socket.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <memory>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <utility>
#include <vector>

namespace nilio::drivers {
namespace {

using core::Error;

/// Datagrams per system call; more are fetched by the next read().
constexpr std::size_t kBatch = 64;
/// A sensor sends hundreds of packets a second.
constexpr std::int64_t kSilenceNs = 1'000'000'000;

std::string buffer_text(int obtained, int requested) {
  std::string text = "receive buffer " + std::to_string(obtained / 1024) + " KiB";
  if (obtained >= requested) return text;
  return text + " of " + std::to_string(requested / 1024) +
         " KiB requested; allow it with 'sysctl -w net.core.rmem_max=" + std::to_string(requested) + "'";
}

std::string where_text(const UdpSourceConfig& config) {
  std::string text = "UDP " + config.bind_address + ":" + std::to_string(config.port);
  if (config.position_port != 0) text += " and " + std::to_string(config.position_port);
  if (!config.multicast_group.empty()) text += " in group " + config.multicast_group;
  return text + ": ";
}

/// One port.
struct Channel {
  UdpSocket socket;
  std::uint16_t port = 0;
  /// As the kernel counted last.
  std::uint32_t drops = 0;
};

class UdpSource final : public PacketSource {
 public:
  UdpSource(std::vector<Channel> channels, const UdpSourceConfig& config, std::uint32_t accepted_sender);

  SourceRead read(std::span<Packet> slots, core::Duration timeout) override;
  [[nodiscard]] SourceStats stats() const override { return counters_.read(); }
  [[nodiscard]] std::string status() const override;

 private:
  struct Control {
    alignas(
        cmsghdr) std::array<char, CMSG_SPACE(sizeof(timespec)) + CMSG_SPACE(sizeof(std::uint32_t))> bytes{};
  };

  bool wait(core::Duration timeout);
  void note_idle();
  std::size_t read_channel(Channel& channel, std::span<Packet> slots);
  int receive(const Channel& channel, std::span<Packet> slots);
  bool fill(std::size_t message, Channel& channel, Packet& slot);
  void read_control(msghdr& header, Channel& channel, Packet& slot);
  void count_drops(Channel& channel, std::uint32_t drops);

  std::vector<Channel> channels_;
  const UdpSourceConfig config_;
  /// 0 = any.
  const std::uint32_t accepted_sender_;
  const std::string buffer_text_;
  SourceCounters counters_;
  UdpSightings sightings_;
  IdleProbe probe_;
  std::atomic<bool> idle_{false};
  std::atomic<int> error_{0};
  /// Whose turn it is to be read first.
  std::size_t first_ = 0;
  std::array<pollfd, 2> polled_{};
  std::array<mmsghdr, kBatch> messages_{};
  std::array<iovec, kBatch> buffers_{};
  std::array<sockaddr_in, kBatch> senders_{};
  std::array<Control, kBatch> controls_{};
};

UdpSource::UdpSource(std::vector<Channel> channels, const UdpSourceConfig& config,
                     std::uint32_t accepted_sender)
    : channels_(std::move(channels)),
      config_(config),
      accepted_sender_(accepted_sender),
      buffer_text_(buffer_text(channels_.front().socket.receive_buffer_bytes, config.receive_buffer_bytes)) {
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    polled_[i] = {.fd = channels_[i].socket.descriptor.get(), .events = POLLIN, .revents = 0};
  }
}

SourceRead UdpSource::read(std::span<Packet> slots, core::Duration timeout) {
  if (error_.load(std::memory_order_relaxed) != 0) return {SourceState::kFailed, 0};
  if (!wait(timeout)) {
    note_idle();
    return {SourceState::kIdle, 0};
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    const std::size_t turn = (first_ + i) % channels_.size();
    if (polled_[turn].revents != 0) kept += read_channel(channels_[turn], slots.subspan(kept));
  }
  // A flood on one port does not shut out the other.
  first_ = (first_ + 1) % channels_.size();
  counters_.add_delivered(kept);
  if (kept > 0) return {SourceState::kData, kept};
  const bool failed = error_.load(std::memory_order_relaxed) != 0;
  return {failed ? SourceState::kFailed : SourceState::kIdle, 0};
}

/// True when there is something to read.
bool UdpSource::wait(core::Duration timeout) {
  const std::int64_t ns = std::max<std::int64_t>(timeout.ns, 0);
  const timespec limit{.tv_sec = ns / 1'000'000'000, .tv_nsec = ns % 1'000'000'000};
  return ppoll(polled_.data(), channels_.size(), &limit, nullptr) > 0;
}

void UdpSource::note_idle() {
  idle_.store(true, std::memory_order_relaxed);
  for (Channel& channel : channels_) {
    if (const auto drops = count_kernel_drops(channel.socket.descriptor.get())) count_drops(channel, *drops);
  }
  probe_.idle(clock_ns(CLOCK_MONOTONIC));
}

/// Returns how many slots were filled.
std::size_t UdpSource::read_channel(Channel& channel, std::span<Packet> slots) {
  const int received = receive(channel, slots);
  if (received < 0) {
    const bool nothing = errno == EAGAIN || errno == EINTR;
    if (!nothing) error_.store(errno, std::memory_order_relaxed);
    return 0;
  }
  if (received > 0) {
    idle_.store(false, std::memory_order_relaxed);
    probe_.stop();
  }
  const std::int64_t received_ns = clock_ns(CLOCK_MONOTONIC);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(received); ++i) {
    slots[i].received_ns = received_ns;
    if (!fill(i, channel, slots[i])) continue;
    // Filtered datagrams leave holes; they are rare.
    if (kept != i) slots[kept] = slots[i];
    ++kept;
  }
  return kept;
}

/// As recvmmsg: the number of datagrams, or -1 and errno.
int UdpSource::receive(const Channel& channel, std::span<Packet> slots) {
  const std::size_t count = std::min(slots.size(), kBatch);
  for (std::size_t i = 0; i < count; ++i) {
    buffers_[i] = {.iov_base = slots[i].data.data(), .iov_len = slots[i].data.size()};
    messages_[i] = {};
    msghdr& header = messages_[i].msg_hdr;
    header.msg_name = &senders_[i];
    header.msg_namelen = sizeof(sockaddr_in);
    header.msg_iov = &buffers_[i];
    header.msg_iovlen = 1;
    header.msg_control = controls_[i].bytes.data();
    header.msg_controllen = controls_[i].bytes.size();
  }
  // MSG_TRUNC reports how long a datagram was that did not fit.
  return recvmmsg(channel.socket.descriptor.get(), messages_.data(), static_cast<unsigned>(count),
                  MSG_DONTWAIT | MSG_TRUNC, nullptr);
}

/// False when it is not for us.
bool UdpSource::fill(std::size_t message, Channel& channel, Packet& slot) {
  const std::size_t sent = messages_[message].msg_len;
  slot.stamp.ns = 0;
  read_control(messages_[message].msg_hdr, channel, slot);
  if (slot.stamp.ns == 0) slot.stamp.ns = clock_ns(CLOCK_REALTIME);
  slot.sender_address = ntohl(senders_[message].sin_addr.s_addr);
  slot.sender_port = ntohs(senders_[message].sin_port);
  slot.destination_port = channel.port;
  slot.size = static_cast<std::uint16_t>(std::min(sent, slot.data.size()));
  slot.truncated = sent > slot.data.size();
  if (accepted_sender_ == 0 || slot.sender_address == accepted_sender_) {
    sightings_.note_accepted(slot, sent, config_);
    return true;
  }
  sightings_.note_other_sender(slot.sender_address);
  counters_.add_other(1);
  return false;
}

void UdpSource::read_control(msghdr& header, Channel& channel, Packet& slot) {
  for (cmsghdr* control = CMSG_FIRSTHDR(&header); control != nullptr;
       control = CMSG_NXTHDR(&header, control)) {
    if (control->cmsg_level != SOL_SOCKET) continue;
    if (control->cmsg_type == SCM_TIMESTAMPNS) {
      timespec stamp{};
      std::memcpy(&stamp, CMSG_DATA(control), sizeof(stamp));
      slot.stamp.ns = static_cast<std::int64_t>(stamp.tv_sec) * 1'000'000'000 + stamp.tv_nsec;
    } else if (control->cmsg_type == SO_RXQ_OVFL) {
      std::uint32_t drops = 0;
      std::memcpy(&drops, CMSG_DATA(control), sizeof(drops));
      count_drops(channel, drops);
    }
  }
}

void UdpSource::count_drops(Channel& channel, std::uint32_t drops) {
  // A datagram that waited in the queue has an older count than the socket itself.
  const auto more = static_cast<std::int32_t>(drops - channel.drops);
  if (more <= 0) return;
  counters_.add_kernel_dropped(static_cast<std::uint64_t>(more));
  channel.drops = drops;
}

std::string UdpSource::status() const {
  const SourceStats stats = counters_.read();
  const std::int64_t now_ns = clock_ns(CLOCK_MONOTONIC);
  std::string text = where_text(config_);
  if (const int error = error_.load(std::memory_order_relaxed); error != 0) {
    return text + "receiving failed: " + std::strerror(error) + "; check the network interface";
  }
  text += sightings_.describe_packets(config_, now_ns) + ", ";
  if (stats.kernel_dropped > 0) text += std::to_string(stats.kernel_dropped) + " dropped by the kernel, ";
  text += buffer_text_ + sightings_.describe_oddities(config_);
  if (!idle_.load(std::memory_order_relaxed) || sightings_.age_ns(now_ns) < kSilenceNs) return text;
  text +=
      stats.delivered + stats.other == 0
          ? "; nothing arrives: check the cable, this computer's address, and the destination address and "
            "port in the sensor's web page"
          : "; nothing arrives any more";
  const std::string& interface =
      config_.multicast_interface.empty() ? config_.bind_address : config_.multicast_interface;
  text += "; " + describe_interfaces(interface);
  const std::string seen = probe_.describe(config_.port);
  return seen.empty() ? text : text + "; " + seen;
}

}  // namespace

core::Result<std::unique_ptr<PacketSource>> open_udp(const UdpSourceConfig& config) {
  const core::Result<std::uint32_t> sender = parse_optional_ipv4(config.sender_address, "sender");
  if (!sender) return Error{where_text(config) + sender.error().message};
  if (config.port == config.position_port) {
    return Error{where_text(config) +
                 "data and position packets need a port each; a position port of 0 goes "
                 "without the latter"};
  }
  std::vector<Channel> channels;
  for (const std::uint16_t port : {config.port, config.position_port}) {
    if (port == 0 && port == config.position_port) continue;
    core::Result<UdpSocket> socket = open_udp_socket(config, port);
    if (!socket) return socket.error();
    channels.push_back({.socket = std::move(socket).value(), .port = port});
  }
  return std::unique_ptr<PacketSource>(std::make_unique<UdpSource>(std::move(channels), config, *sender));
}

}  // namespace nilio::drivers
