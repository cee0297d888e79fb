#pragma once

#include "nilio/drivers/network/udp.hpp"
#include "nilio/drivers/packet.hpp"

#include "drivers/common/key_counter.hpp"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string>

namespace nilio::drivers {

/// Everything that came to a UDP source's ports, for its status line. The receive thread notes, any thread
/// describes; noting neither locks nor allocates.
class UdpSightings {
 public:
  /// `sent_bytes` is the datagram's size before it was cut to the slot.
  void note_accepted(const Packet& packet, std::size_t sent_bytes, const UdpSourceConfig& config);
  void note_other_sender(std::uint32_t address) { other_senders_.count(address); }

  /// "12 data and 3 position packets, the last 0.1 s ago". `now_ns` is CLOCK_MONOTONIC.
  [[nodiscard]] std::string describe_packets(const UdpSourceConfig& config, std::int64_t now_ns) const;
  /// What was seen beside good packets of one sensor and what to do about it; empty or beginning with "; ".
  [[nodiscard]] std::string describe_oddities(const UdpSourceConfig& config) const;
  /// Since the last accepted packet; the largest value when there was none.
  [[nodiscard]] std::int64_t age_ns(std::int64_t now_ns) const;

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
  /// 0 = never.
  std::atomic<std::int64_t> last_ns_{0};
};

}  // namespace nilio::drivers
