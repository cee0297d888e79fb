#include "tools/bench/receive/receive_trial.hpp"

#include "nilio/core/clock.hpp"
#include "nilio/drivers/network/udp.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "daemon/input/receive.hpp"
#include "tools/common/system.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <memory>
#include <netinet/in.h>
#include <optional>
#include <span>
#include <string>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

namespace nilio::tools::bench {
namespace {

using core::Duration;
using core::Error;
using core::Result;

constexpr std::size_t kNumberAt = 1200;  // offset of the time stamp
constexpr std::uint64_t kMaxMarkers = 100;
constexpr std::int64_t kMarkerWaitNs = 200'000'000;
constexpr std::int64_t kPollNs = 1'000'000;

double clock_seconds(clockid_t clock) { return static_cast<double>(clock_ns(clock)) * 1e-9; }

void sleep_ns(std::int64_t ns) { sleep_for({ns}); }

std::array<std::uint8_t, drivers::kDataPacketSize> vls128_packet() {
  drivers::VelodyneDataPacket packet;
  constexpr std::array<std::uint16_t, 4> kFlags{0xEEFF, 0xDDFF, 0xCCFF, 0xBBFF};
  for (std::size_t b = 0; b < packet.blocks.size(); ++b) {
    packet.blocks[b].flag = kFlags[b % kFlags.size()];
    for (auto& entry : packet.blocks[b].entries) entry = {2500, 30};
  }
  packet.factory_byte_1 = 0x37;
  packet.factory_byte_2 = 0xA1;
  return drivers::encode(packet);
}

/// Sends numbered packets to a port of 127.0.0.1.
class LoopbackSender {
 public:
  explicit LoopbackSender(std::uint16_t port) : socket_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(port);
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    good_ = connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof(to)) == 0;
  }
  LoopbackSender(const LoopbackSender&) = delete;
  LoopbackSender& operator=(const LoopbackSender&) = delete;
  ~LoopbackSender() { close(socket_); }

  /// False when the kernel refuses the packet.
  bool send(std::uint32_t number) {
    for (std::size_t i = 0; i < 4; ++i) {
      packet_[kNumberAt + i] = static_cast<std::uint8_t>(number >> (8 * i));
    }
    return good_ && ::send(socket_, packet_.data(), packet_.size(), 0) >= 0;
  }

 private:
  int socket_;
  bool good_ = false;
  std::array<std::uint8_t, drivers::kDataPacketSize> packet_ = vls128_packet();
};

/// Wraps a source: counts batches and sleeps at intervals instead of reading. Only for the receive thread.
class StallingSource final : public drivers::PacketSource {
 public:
  StallingSource(drivers::PacketSource& source, const ReceiveTrialOptions& options)
      : source_(source), options_(options), next_stall_s_(clock_seconds(CLOCK_MONOTONIC)) {}

  drivers::SourceRead read(std::span<drivers::Packet> slots, Duration timeout) override {
    if (options_.stall_s > 0.0 && clock_seconds(CLOCK_MONOTONIC) >= next_stall_s_) {
      sleep_ns(Duration::from_seconds(options_.stall_s).ns);
      ++stalls_;
      next_stall_s_ = clock_seconds(CLOCK_MONOTONIC) + options_.stall_period_s - options_.stall_s;
    }
    const drivers::SourceRead read = source_.read(slots, timeout);
    if (read.count > 0) ++batches_;
    packets_ += read.count;
    largest_ = std::max(largest_, read.count);
    return read;
  }
  [[nodiscard]] drivers::SourceStats stats() const override { return source_.stats(); }
  [[nodiscard]] std::string status() const override { return source_.status(); }

  void report(ReceiveTrialResult& result) const {
    result.stalls = stalls_;
    result.largest_batch = largest_;
    if (batches_ > 0) result.mean_batch = static_cast<double>(packets_) / static_cast<double>(batches_);
  }

 private:
  drivers::PacketSource& source_;
  const ReceiveTrialOptions& options_;
  double next_stall_s_;
  std::uint64_t stalls_ = 0;
  std::uint64_t batches_ = 0;
  std::uint64_t packets_ = 0;
  std::size_t largest_ = 0;
};

/// Records the packet numbers that come out of the ring.
class NumberCheck {
 public:
  explicit NumberCheck(std::uint64_t numbers) : seen_(numbers, false) {}

  void add(const drivers::Packet& packet) {
    std::uint32_t number = 0;
    for (std::size_t i = 0; i < 4; ++i)
      number |= static_cast<std::uint32_t>(packet.data[kNumberAt + i]) << (8 * i);
    const bool right = packet.size == drivers::kDataPacketSize && number < seen_.size() && !seen_[number];
    if (!right) {
      ++wrong_;
      return;
    }
    seen_[number] = true;
    ++received_;
    last_.store(number, std::memory_order_release);
  }
  /// Last number. Any thread.
  [[nodiscard]] std::int64_t last() const { return last_.load(std::memory_order_acquire); }

  void report(std::uint64_t sent, ReceiveTrialResult& result) const {
    result.sent = sent;
    result.received = received_;
    result.wrong = wrong_;
    result.missing = static_cast<std::uint64_t>(
        std::count(seen_.begin(), seen_.begin() + static_cast<std::ptrdiff_t>(sent), false));
  }

 private:
  std::vector<bool> seen_;
  std::uint64_t received_ = 0;
  std::uint64_t wrong_ = 0;
  std::atomic<std::int64_t> last_{-1};
};

bool send_at_rate(LoopbackSender& sender, const ReceiveTrialOptions& options) {
  const double start = clock_seconds(CLOCK_MONOTONIC);
  std::uint64_t sent = 0;
  while (sent < options.packets) {
    const double elapsed = clock_seconds(CLOCK_MONOTONIC) - start;
    const auto due = static_cast<std::uint64_t>(elapsed * options.rate_hz) + 1;
    for (; sent < std::min(due, options.packets); ++sent) {
      if (!sender.send(static_cast<std::uint32_t>(sent))) return false;
    }
    const double wait = start + static_cast<double>(sent) / options.rate_hz - clock_seconds(CLOCK_MONOTONIC);
    if (wait > 0.0) sleep_ns(Duration::from_seconds(wait).ns);
  }
  return true;
}

/// Sends further packets until one arrives; all drops before it are counted then. Returns the number of
/// packets sent, or nothing when none arrived.
std::optional<std::uint64_t> send_markers(LoopbackSender& sender, std::uint64_t first,
                                          const NumberCheck& check) {
  for (std::uint64_t i = 0; i < kMaxMarkers; ++i) {
    const std::uint64_t number = first + i;
    if (!sender.send(static_cast<std::uint32_t>(number))) return std::nullopt;
    for (std::int64_t waited = 0; waited < kMarkerWaitNs; waited += kPollNs) {
      if (check.last() == static_cast<std::int64_t>(number)) return i + 1;
      sleep_ns(kPollNs);
    }
  }
  return std::nullopt;
}

void drain_ring(ipc::Ring<drivers::Packet>& ring, ipc::WakeEvent& event, const daemon::ReceiveState& state,
                NumberCheck& check) {
  for (;;) {
    const bool ended = state.ended.load(std::memory_order_acquire);
    const std::span<const drivers::Packet> packets = ring.begin_read();
    for (const drivers::Packet& packet : packets) check.add(packet);
    ring.consume(packets.size());
    if (!packets.empty()) continue;
    if (ended) return;
    event.wait({kMarkerWaitNs});
  }
}

}  // namespace

core::Result<ReceiveTrialResult> try_receiving(const ReceiveTrialOptions& options) {
  const Result<std::array<std::uint16_t, 2>> ports = free_udp_ports(0);
  if (!ports) return Error{"no UDP port of 127.0.0.1 is free - check the loopback interface"};
  drivers::UdpSourceConfig config;
  config.bind_address = "127.0.0.1";
  config.port = ports->front();
  config.position_port = 0;
  config.receive_buffer_bytes = options.receive_buffer_bytes;
  Result<std::unique_ptr<drivers::PacketSource>> udp = drivers::open_udp(config);
  if (!udp) return udp.error();
  Result<ipc::WakeEvent> event = ipc::WakeEvent::create();
  if (!event) return event.error();
  auto ring = ipc::Ring<drivers::Packet>::in_private_memory(options.ring_slots);
  StallingSource source(**udp, options);
  NumberCheck check(options.packets + kMaxMarkers);
  LoopbackSender sender(config.port);
  daemon::ReceiveState state;
  ReceiveTrialResult result;

  std::thread receiver([&] {
    const double cpu = clock_seconds(CLOCK_THREAD_CPUTIME_ID);
    const double wall = clock_seconds(CLOCK_MONOTONIC);
    const daemon::ReceivePolicy policy{.rules = daemon::RunRules::Kind::kLive, .pace = {}};
    daemon::PacketReceiver packets(source, ring, *event, policy, state);
    while (packets.run()) {
    }
    packets.finish();
    result.cpu_share =
        (clock_seconds(CLOCK_THREAD_CPUTIME_ID) - cpu) / (clock_seconds(CLOCK_MONOTONIC) - wall);
  });
  std::thread consumer([&] { drain_ring(ring, *event, state, check); });
  const bool sent = send_at_rate(sender, options);
  const int send_error = errno;
  const std::optional<std::uint64_t> markers =
      sent ? send_markers(sender, options.packets, check) : std::nullopt;
  state.stop.store(true);
  receiver.join();
  consumer.join();
  if (!sent) return Error{std::string("sending over loopback failed: ") + std::strerror(send_error)};
  if (!markers)
    return Error{"no more packets arrived (" + (*udp)->status() + ") - check the loopback interface"};
  check.report(options.packets + *markers, result);
  source.report(result);
  result.kernel_dropped = (*udp)->stats().kernel_dropped;
  result.ring_dropped = ring.dropped();
  return result;
}

}  // namespace nilio::tools::bench
