#pragma once

#include "nilio/drivers/packet.hpp"

#include "tools/mangle/faults.hpp"
#include "tools/simulate/random.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace nilio::tools::mangle {

/// Packets that each fault met.
struct PacketCounts {
  std::uint64_t packets = 0;  ///< of the original recording
  std::uint64_t written = 0;
  std::uint64_t lost_in_gaps = 0;
  std::uint64_t lost = 0;
  std::uint64_t lost_in_bursts = 0;
  std::uint64_t duplicated = 0;
  std::uint64_t reordered = 0;  ///< pairs that changed places
  std::uint64_t restamped = 0;
};

/// Sum of the steps of the host's clock up to `stamp`, for a recording that began at `begin`.
core::Duration clock_error(const Faults& faults, core::Time begin, core::Time stamp);

/// Applies the faults of the stream to packets in the order of their arrival. One thread.
class PacketFaults {
 public:
  PacketFaults(const Faults& faults, core::Time begin);

  /// Appends what arrives of the packet to `out`: nothing, it, or it twice; a reordered one later.
  void add(const drivers::Packet& packet, std::vector<drivers::Packet>& out);
  /// Appends a packet that was still held back.
  void finish(std::vector<drivers::Packet>& out);
  [[nodiscard]] const PacketCounts& counts() const { return counts_; }
  /// Packets that were lost in each gap, in the order of Faults::gaps.
  [[nodiscard]] const std::vector<std::uint64_t>& lost_in_gap() const { return lost_in_gap_; }

 private:
  [[nodiscard]] bool is_lost(const drivers::Packet& packet);
  [[nodiscard]] bool is_in_gap(double seconds);
  [[nodiscard]] bool is_in_burst(double seconds);
  void schedule_burst(double after_s);
  void deliver(drivers::Packet packet, std::vector<drivers::Packet>& out);

  Faults faults_;
  core::Time begin_;
  simulate::RandomStream losses_;
  simulate::RandomStream bursts_;
  simulate::RandomStream duplicates_;
  simulate::RandomStream orders_;
  double next_burst_s_ = 0.0;
  unsigned left_in_burst_ = 0;
  std::optional<drivers::Packet> held_;
  PacketCounts counts_;
  std::vector<std::uint64_t> lost_in_gap_;
};

}  // namespace nilio::tools::mangle
