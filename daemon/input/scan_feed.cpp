#include "daemon/input/scan_feed.hpp"

#include <algorithm>
#include <utility>

namespace nilio::daemon {

PacketScanFeed::PacketScanFeed(LidarChannel& channel, ipc::WakeEvent& data_event)
    : channel_(channel), data_event_(data_event) {}

void PacketScanFeed::take(core::Scan& scan) {
  channel_.take_scan(scan);
  scan.completed_ns = monotonic_ns();
  packets_per_scan_ = packets_in_scan_;
  packets_in_scan_ = 0;
}

bool PacketScanFeed::drain(core::Scan& scan) {
  while (channel_.front() != nullptr) {
    const std::int64_t popped_ns = monotonic_ns();
    const bool complete = channel_.decode_front();
    ++packets_in_scan_;
    if (complete) {
      take(scan);
      // Packets buffered during identification count as received when they are decoded.
      scan.popped_ns = std::max(popped_ns, scan.received_ns);
      return true;
    }
  }
  return false;
}

/// Ends the last scan of the input; true if it is complete.
bool PacketScanFeed::end(core::Scan& scan) {
  if (std::exchange(finished_, true)) return false;
  const bool complete = channel_.finish_scan();
  if (complete) take(scan);
  channel_.report_status();
  return complete;
}

FeedState PacketScanFeed::poll(core::Scan& scan) {
  const bool ended = channel_.ended();
  if (drain(scan)) return FeedState::kScan;
  if (!ended) return FeedState::kIdle;
  return end(scan) ? FeedState::kScan : FeedState::kEnd;
}

FeedState PacketScanFeed::next(core::Scan& scan, core::Duration timeout) {
  FeedState state = poll(scan);
  while (state == FeedState::kIdle && data_event_.wait(timeout)) state = poll(scan);
  return state;
}

std::size_t PacketScanFeed::waiting_scans() const {
  if (channel_.is_catching_up()) return 0;
  return packets_per_scan_ > 0 ? channel_.packets_in_ring() / packets_per_scan_ : 0;
}

}  // namespace nilio::daemon
