#include "nilio/drivers/udp.hpp"

#include "source_support.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <memory>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

namespace nilio::drivers {
namespace {

using core::Error;

/// Datagrams per system call; more are fetched by the next read().
constexpr std::size_t kBatch = 64;

class Socket {
 public:
  explicit Socket(int descriptor) : descriptor_(descriptor) {}
  Socket(Socket&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}
  Socket& operator=(Socket&&) = delete;
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  ~Socket() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  [[nodiscard]] int get() const { return descriptor_; }

 private:
  int descriptor_;
};

std::string address_text(std::uint32_t address) {
  std::array<char, INET_ADDRSTRLEN> text{};
  const in_addr network{htonl(address)};
  inet_ntop(AF_INET, &network, text.data(), text.size());
  return text.data();
}

std::string buffer_text(int obtained, int requested) {
  std::string text = "receive buffer " + std::to_string(obtained / 1024) + " KiB";
  if (obtained >= requested) return text;
  return text + " of " + std::to_string(requested / 1024) +
         " KiB requested; allow it with 'sysctl -w net.core.rmem_max=" + std::to_string(requested) + "'";
}

class UdpSource final : public PacketSource {
 public:
  UdpSource(Socket socket, const UdpSourceConfig& config, std::uint32_t accepted_sender, int buffer_bytes);

  SourceRead read(std::span<Packet> slots, core::Duration timeout) override;
  [[nodiscard]] SourceStats stats() const override { return counters_.read(); }
  [[nodiscard]] std::string status() const override;

 private:
  struct Control {
    alignas(
        cmsghdr) std::array<char, CMSG_SPACE(sizeof(timespec)) + CMSG_SPACE(sizeof(std::uint32_t))> bytes{};
  };

  int receive(std::span<Packet> slots);
  bool wait(core::Duration timeout);
  SourceRead fail(int error);
  void read_control(msghdr& header, Packet& slot);
  bool fill(std::size_t message, Packet& slot, std::int64_t received_ns);

  Socket socket_;
  const UdpSourceConfig config_;
  /// 0 = any.
  const std::uint32_t accepted_sender_;
  const std::string buffer_text_;
  SourceCounters counters_;
  std::atomic<std::uint32_t> other_sender_{0};
  std::atomic<int> error_{0};
  std::uint32_t last_drop_count_ = 0;
  std::array<mmsghdr, kBatch> messages_{};
  std::array<iovec, kBatch> buffers_{};
  std::array<sockaddr_in, kBatch> senders_{};
  std::array<Control, kBatch> controls_{};
};

UdpSource::UdpSource(Socket socket, const UdpSourceConfig& config, std::uint32_t accepted_sender,
                     int buffer_bytes)
    : socket_(std::move(socket)),
      config_(config),
      accepted_sender_(accepted_sender),
      buffer_text_(buffer_text(buffer_bytes, config.receive_buffer_bytes)) {}

SourceRead UdpSource::read(std::span<Packet> slots, core::Duration timeout) {
  if (error_.load(std::memory_order_relaxed) != 0) return {SourceState::kFailed, 0};
  int received = receive(slots);
  if (received < 0 && errno == EAGAIN) {
    if (!wait(timeout)) return {SourceState::kIdle, 0};
    received = receive(slots);
  }
  if (received < 0)
    return errno == EAGAIN || errno == EINTR ? SourceRead{SourceState::kIdle, 0} : fail(errno);
  const std::int64_t received_ns = clock_ns(CLOCK_MONOTONIC);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(received); ++i) {
    if (!fill(i, slots[i], received_ns)) continue;
    // Filtered datagrams leave holes; they are rare.
    if (kept != i) slots[kept] = slots[i];
    ++kept;
  }
  counters_.add_delivered(kept);
  return {kept > 0 ? SourceState::kData : SourceState::kIdle, kept};
}

/// As recvmmsg: the number of datagrams, or -1 and errno.
int UdpSource::receive(std::span<Packet> slots) {
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
  return recvmmsg(socket_.get(), messages_.data(), static_cast<unsigned>(count), MSG_DONTWAIT, nullptr);
}

bool UdpSource::wait(core::Duration timeout) {
  const std::int64_t ns = std::max<std::int64_t>(timeout.ns, 0);
  const timespec limit{.tv_sec = ns / 1'000'000'000, .tv_nsec = ns % 1'000'000'000};
  pollfd descriptor{.fd = socket_.get(), .events = POLLIN, .revents = 0};
  return ppoll(&descriptor, 1, &limit, nullptr) > 0;
}

SourceRead UdpSource::fail(int error) {
  error_.store(error, std::memory_order_relaxed);
  return {SourceState::kFailed, 0};
}

bool UdpSource::fill(std::size_t message, Packet& slot, std::int64_t received_ns) {
  msghdr& header = messages_[message].msg_hdr;
  slot.stamp.ns = 0;
  read_control(header, slot);
  if (slot.stamp.ns == 0) slot.stamp.ns = clock_ns(CLOCK_REALTIME);
  slot.received_ns = received_ns;
  slot.sender_address = ntohl(senders_[message].sin_addr.s_addr);
  slot.sender_port = ntohs(senders_[message].sin_port);
  slot.destination_port = config_.port;
  slot.size = static_cast<std::uint16_t>(std::min<std::size_t>(messages_[message].msg_len, slot.data.size()));
  slot.truncated = (header.msg_flags & MSG_TRUNC) != 0;
  if (accepted_sender_ == 0 || slot.sender_address == accepted_sender_) return true;
  other_sender_.store(slot.sender_address, std::memory_order_relaxed);
  counters_.add_other(1);
  return false;
}

void UdpSource::read_control(msghdr& header, Packet& slot) {
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
      counters_.add_kernel_dropped(drops - last_drop_count_);
      last_drop_count_ = drops;
    }
  }
}

std::string UdpSource::status() const {
  const SourceStats stats = counters_.read();
  std::string text = "UDP " + config_.bind_address + ":" + std::to_string(config_.port) + ": ";
  if (const int error = error_.load(std::memory_order_relaxed); error != 0) {
    return text + "receiving failed: " + std::strerror(error) + "; check the network interface";
  }
  text += std::to_string(stats.delivered) + " packets, ";
  if (stats.kernel_dropped > 0) text += std::to_string(stats.kernel_dropped) + " dropped by the kernel, ";
  text += buffer_text_;
  if (stats.other > 0) {
    text += "; " + std::to_string(stats.other) + " ignored, the last from " +
            address_text(other_sender_.load(std::memory_order_relaxed)) + ", since only " +
            config_.sender_address + " is accepted";
  } else if (stats.delivered == 0) {
    text +=
        "; nothing arrives: check the cable, this computer's address and the destination address and port in "
        "the "
        "sensor's web page";
  }
  return text;
}

/// Sets the options and returns the receive buffer obtained.
core::Result<int> configure(int descriptor, const UdpSourceConfig& config, const std::string& where) {
  const int on = 1;
  if (setsockopt(descriptor, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof(on)) != 0 ||
      setsockopt(descriptor, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof(on)) != 0) {
    return Error{where + "kernel time stamps and drop counts cannot be had: " + std::strerror(errno)};
  }
  const int wanted = config.receive_buffer_bytes;
  // Beyond net.core.rmem_max only with CAP_NET_ADMIN; without it, as much as is allowed.
  if (setsockopt(descriptor, SOL_SOCKET, SO_RCVBUFFORCE, &wanted, sizeof(wanted)) != 0) {
    setsockopt(descriptor, SOL_SOCKET, SO_RCVBUF, &wanted, sizeof(wanted));
  }
  int obtained = 0;
  socklen_t length = sizeof(obtained);
  getsockopt(descriptor, SOL_SOCKET, SO_RCVBUF, &obtained, &length);
  // The kernel reports twice what was asked, the second half being for its own bookkeeping.
  return obtained / 2;
}

core::Result<std::uint32_t> parse_address(const std::string& text, const std::string& use) {
  in_addr address{};
  if (inet_pton(AF_INET, text.c_str(), &address) != 1) {
    return Error{"'" + text + "' is no IPv4 address for the " + use + "; write it as 192.168.1.201"};
  }
  return ntohl(address.s_addr);
}

std::string bind_advice(int error, std::uint16_t port) {
  if (error == EADDRINUSE) {
    return "another program has this port; 'ss -ulpn sport = :" + std::to_string(port) + "' names it";
  }
  if (error == EADDRNOTAVAIL)
    return "no interface has this address; 'ip -4 address' lists them, 0.0.0.0 means all";
  if (error == EACCES) return "ports below 1024 need CAP_NET_BIND_SERVICE";
  return "check the address and the port";
}

}  // namespace

core::Result<std::unique_ptr<PacketSource>> open_udp(const UdpSourceConfig& config) {
  const std::string where = "UDP " + config.bind_address + ":" + std::to_string(config.port) + ": ";
  const core::Result<std::uint32_t> local = parse_address(config.bind_address, "address to listen on");
  if (!local) return Error{where + local.error().message};
  std::uint32_t sender = 0;
  if (!config.sender_address.empty()) {
    const core::Result<std::uint32_t> parsed = parse_address(config.sender_address, "sender");
    if (!parsed) return Error{where + parsed.error().message};
    sender = *parsed;
  }
  Socket socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (socket.get() < 0) return Error{where + "no socket: " + std::strerror(errno)};
  const core::Result<int> buffer = configure(socket.get(), config, where);
  if (!buffer) return buffer.error();
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(config.port);
  address.sin_addr.s_addr = htonl(*local);
  if (bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    const int error = errno;
    return Error{where + "cannot listen: " + std::strerror(error) + "; " + bind_advice(error, config.port)};
  }
  return std::unique_ptr<PacketSource>(
      std::make_unique<UdpSource>(std::move(socket), config, sender, *buffer));
}

}  // namespace nilio::drivers
