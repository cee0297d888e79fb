#include "nilio/core/clock.hpp"
#include "nilio/drivers/network/udp.hpp"

#include "drivers/common/counters.hpp"
#include "drivers/common/socket.hpp"
#include "drivers/network/idle_probe.hpp"
#include "drivers/network/interfaces.hpp"
#include "drivers/network/sockets.hpp"
#include "drivers/network/udp_traffic.hpp"

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
/// Without data packets for this long, status() looks for the cause: a sensor sends hundreds a second.
constexpr std::int64_t kSilenceNs = 1'000'000'000;

std::string where_text(const UdpSourceConfig& config) {
  std::string text = "UDP " + config.bind_address + ":" + std::to_string(config.port);
  if (config.position_port != 0) text += " and " + std::to_string(config.position_port);
  if (!config.multicast_group.empty()) text += " in group " + config.multicast_group;
  return text + ": ";
}

/// One UDP port of the sensor.
struct Port {
  UdpSocket socket;
  std::uint16_t port = 0;
  /// Latest drop count of the kernel.
  std::uint32_t drops = 0;
};

class UdpSource final : public PacketSource {
 public:
  UdpSource(std::vector<Port> ports, const UdpSourceConfig& config, std::uint32_t accepted_sender);

  SourceRead read(std::span<Packet> slots, core::Duration timeout) override;
  [[nodiscard]] SourceStats stats() const override { return counters_.read(); }
  [[nodiscard]] std::string status() const override;

 private:
  bool wait(core::Duration timeout);
  void note_idle();
  void note_missing_data(std::int64_t now_ns);
  std::size_t receive_from(Port& port, std::span<Packet> slots);
  int receive(const Port& port, std::span<Packet> slots);
  bool fill(std::size_t message, Port& port, Packet& slot);
  void count_drops(Port& port, std::uint32_t drops);

  std::vector<Port> ports_;
  const UdpSourceConfig config_;
  /// Host byte order; 0 = any.
  const std::uint32_t accepted_sender_;
  const std::string buffer_text_;
  SourceCounters counters_;
  UdpTraffic traffic_;
  IdleProbe probe_;
  std::atomic<bool> idle_{false};
  std::atomic<int> error_{0};
  /// Index of the port that is read first.
  std::size_t first_ = 0;
  std::array<pollfd, 2> polled_{};
  std::array<mmsghdr, kBatch> messages_{};
  std::array<iovec, kBatch> buffers_{};
  std::array<sockaddr_in, kBatch> senders_{};
  std::array<ControlBuffer, kBatch> controls_{};
};

UdpSource::UdpSource(std::vector<Port> ports, const UdpSourceConfig& config, std::uint32_t accepted_sender)
    : ports_(std::move(ports)),
      config_(config),
      accepted_sender_(accepted_sender),
      buffer_text_(
          describe_receive_buffer(ports_.front().socket.receive_buffer_bytes, config.receive_buffer_bytes)) {
  for (std::size_t i = 0; i < ports_.size(); ++i) {
    polled_[i] = {.fd = ports_[i].socket.descriptor.get(), .events = POLLIN, .revents = 0};
  }
}

SourceRead UdpSource::read(std::span<Packet> slots, core::Duration timeout) {
  if (error_.load(std::memory_order_relaxed) != 0) return {SourceState::kFailed, 0};
  if (!wait(timeout)) {
    note_idle();
    note_missing_data(monotonic_ns());
    return {SourceState::kIdle, 0};
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < ports_.size(); ++i) {
    const std::size_t turn = (first_ + i) % ports_.size();
    if (polled_[turn].revents != 0) kept += receive_from(ports_[turn], slots.subspan(kept));
  }
  // Rotating the order keeps a flooded port from starving the other.
  first_ = (first_ + 1) % ports_.size();
  counters_.add_delivered(kept);
  if (kept > 0) return {SourceState::kData, kept};
  const bool failed = error_.load(std::memory_order_relaxed) != 0;
  return {failed ? SourceState::kFailed : SourceState::kIdle, 0};
}

/// True when there is something to read.
bool UdpSource::wait(core::Duration timeout) {
  const timespec limit = to_timespec(timeout);
  return ppoll(polled_.data(), ports_.size(), &limit, nullptr) > 0;
}

void UdpSource::note_idle() {
  for (Port& port : ports_) {
    if (const auto drops = count_kernel_drops(port.socket.descriptor.get())) count_drops(port, *drops);
  }
}

/// Position packets alone are no sign that data packets reach the right port.
void UdpSource::note_missing_data(std::int64_t now_ns) {
  idle_.store(true, std::memory_order_relaxed);
  probe_.idle(now_ns);
}

/// Returns how many slots were filled.
std::size_t UdpSource::receive_from(Port& port, std::span<Packet> slots) {
  const int received = receive(port, slots);
  if (received < 0) {
    const bool nothing = errno == EAGAIN || errno == EINTR;
    if (!nothing) error_.store(errno, std::memory_order_relaxed);
    return 0;
  }
  const std::int64_t received_ns = monotonic_ns();
  std::size_t kept = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(received); ++i) {
    slots[i].received_ns = received_ns;
    if (!fill(i, port, slots[i])) continue;
    // Close the gaps that filtered datagrams leave; they are rare.
    if (kept != i) slots[kept] = slots[i];
    ++kept;
  }
  if (port.port == config_.port && kept > 0) {
    idle_.store(false, std::memory_order_relaxed);
    probe_.stop();
  } else if (traffic_.data_age_ns(received_ns) > kSilenceNs) {
    note_missing_data(received_ns);
  }
  return kept;
}

/// Returns as recvmmsg() does: the number of datagrams, or -1 and errno.
int UdpSource::receive(const Port& port, std::span<Packet> slots) {
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
  // MSG_TRUNC reports the full length of datagrams that did not fit.
  return recvmmsg(port.socket.descriptor.get(), messages_.data(), static_cast<unsigned>(count),
                  MSG_DONTWAIT | MSG_TRUNC, nullptr);
}

/// False for a datagram of another sender.
bool UdpSource::fill(std::size_t message, Port& port, Packet& slot) {
  const std::size_t sent = messages_[message].msg_len;
  const ReceivedControl control = read_control(messages_[message].msg_hdr);
  if (control.drops) count_drops(port, *control.drops);
  slot.stamp = control.stamp;
  slot.sender_address = ntohl(senders_[message].sin_addr.s_addr);
  slot.sender_port = ntohs(senders_[message].sin_port);
  slot.destination_port = port.port;
  slot.size = static_cast<std::uint16_t>(std::min(sent, slot.data.size()));
  slot.truncated = sent > slot.data.size();
  if (accepted_sender_ == 0 || slot.sender_address == accepted_sender_) {
    traffic_.on_accepted(slot, sent, config_);
    return true;
  }
  traffic_.on_other_sender(slot.sender_address);
  counters_.add_other(1);
  return false;
}

void UdpSource::count_drops(Port& port, std::uint32_t drops) {
  // A datagram from the queue carries an older count than SO_MEMINFO.
  const auto more = static_cast<std::int32_t>(drops - port.drops);
  if (more <= 0) return;
  counters_.add_kernel_dropped(static_cast<std::uint64_t>(more));
  port.drops = drops;
}

std::string UdpSource::status() const {
  const SourceStats stats = counters_.read();
  const std::int64_t now_ns = monotonic_ns();
  std::string text = where_text(config_);
  if (const int error = error_.load(std::memory_order_relaxed); error != 0) {
    return text + "receiving failed: " + std::strerror(error) + "; check the network interface";
  }
  text += traffic_.describe_packets(config_, now_ns) + ", ";
  if (stats.kernel_dropped > 0) text += std::to_string(stats.kernel_dropped) + " dropped by the kernel, ";
  text += buffer_text_ + traffic_.describe_problems(config_);
  if (!idle_.load(std::memory_order_relaxed) || traffic_.data_age_ns(now_ns) < kSilenceNs) return text;
  if (stats.delivered + stats.other == 0) {
    text +=
        "; nothing arrives: check the cable, this computer's address, and the destination address and port "
        "in the sensor's web page";
  } else if (traffic_.has_data()) {
    text += "; no data packets arrive any more";
  }
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
                 "data and position packets need a port each; a position port of 0 "
                 "disables the latter"};
  }
  std::vector<Port> ports;
  for (const std::uint16_t port : {config.port, config.position_port}) {
    if (port == 0 && port == config.position_port) continue;
    core::Result<UdpSocket> socket = open_udp_socket(config, port);
    if (!socket) return socket.error();
    ports.push_back({.socket = std::move(socket).value(), .port = port});
  }
  return std::unique_ptr<PacketSource>(std::make_unique<UdpSource>(std::move(ports), config, *sender));
}

}  // namespace nilio::drivers
