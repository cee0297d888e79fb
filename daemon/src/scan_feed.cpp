#include "nilio/daemon/scan_feed.hpp"

#include <utility>

namespace nilio::daemon {

PacketScanFeed::PacketScanFeed(drivers::ScanAssembler assembler, ipc::Ring<drivers::Packet>& ring,
                               ipc::WakeEvent& data_event, const ReceiveState& receive_state)
    : assembler_(std::move(assembler)), ring_(ring), data_event_(data_event), receive_state_(receive_state) {}

void PacketScanFeed::take(core::Scan& scan) {
  assembler_.take_scan(scan);
  scan.completed_ns = monotonic_ns();
  packets_per_scan_ = packets_in_scan_;
  packets_in_scan_ = 0;
}

bool PacketScanFeed::drain(core::Scan& scan) {
  for (std::span<const drivers::Packet> slots = ring_.begin_read(); !slots.empty();
       slots = ring_.begin_read()) {
    for (const drivers::Packet& packet : slots) {
      const std::int64_t popped_ns = monotonic_ns();
      const bool complete = assembler_.add(packet);
      ring_.consume(1);
      ++packets_in_scan_;
      if (complete) {
        take(scan);
        scan.popped_ns = popped_ns;
        return true;
      }
    }
  }
  return false;
}

FeedState PacketScanFeed::next(core::Scan& scan, core::Duration timeout) {
  while (true) {
    // Read before draining: what was committed before the end was announced is then seen.
    const bool ended = receive_state_.ended.load(std::memory_order_acquire);
    if (drain(scan)) return FeedState::kScan;
    if (ended) {
      if (std::exchange(finished_, true) || !assembler_.finish()) return FeedState::kEnd;
      take(scan);
      return FeedState::kScan;
    }
    if (!data_event_.wait(timeout)) return FeedState::kIdle;
  }
}

std::size_t PacketScanFeed::waiting_scans() const {
  return packets_per_scan_ > 0 ? ring_.size() / packets_per_scan_ : 0;
}

}  // namespace nilio::daemon
