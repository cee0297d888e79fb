#pragma once

#include "nilio/drivers/network/udp.hpp"
#include "nilio/drivers/packet.hpp"

#include "drivers/common/counters.hpp"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string>

namespace nilio::drivers {

/// Counts the datagrams on a UDP source's ports for its status line. The receive thread calls on_*(), which
/// neither lock nor allocate; any thread calls describe_*().
class UdpTraffic {
 public:
  /// `sent_bytes` is the datagram's size before it was cut to the slot.
  void on_accepted(const Packet& packet, std::size_t sent_bytes, const UdpSourceConfig& config);
  void on_other_sender(std::uint32_t address) { other_senders_.count(address); }

  /// "12 data and 3 position packets, the last 0.1 s ago". `now_ns` is CLOCK_MONOTONIC.
  [[nodiscard]] std::string describe_packets(const UdpSourceConfig& config, std::int64_t now_ns) const;
  /// Traffic other than good packets of one sensor, and the remedy; empty or beginning with "; ".
  [[nodiscard]] std::string describe_problems(const UdpSourceConfig& config) const;
  [[nodiscard]] bool has_data() const { return data_packets_.load(std::memory_order_relaxed) > 0; }
  /// Time since the last accepted data packet; the largest value before the first.
  [[nodiscard]] std::int64_t data_age_ns(std::int64_t now_ns) const;

 private:
  struct PortAndSize {
    std::uint16_t port = 0;
    std::uint16_t size = 0;
    friend bool operator==(const PortAndSize&, const PortAndSize&) = default;
  };

  KeyCounter<std::uint32_t, 8> senders_;
  KeyCounter<std::uint32_t, 8> other_senders_;
  KeyCounter<PortAndSize, 8> wrong_sizes_;
  std::atomic<std::uint64_t> data_packets_{0};
  std::atomic<std::uint64_t> position_packets_{0};
  /// CLOCK_MONOTONIC of the last accepted packet and data packet; 0 = none yet.
  std::atomic<std::int64_t> last_ns_{0};
  std::atomic<std::int64_t> last_data_ns_{0};
};

}  // namespace nilio::drivers
