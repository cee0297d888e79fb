#include "daemon/input/scan_feed.hpp"

#include <algorithm>
#include <utility>

namespace nilio::daemon {

namespace {

// Share of a scan period in which no packet can complete the next scan: motors hold their speed to 1 %.
constexpr double kGatherShare = 0.95;
// Longer periods contain a gap.
constexpr std::int64_t kLongestPeriodNs = 300'000'000;

}  // namespace

PacketScanFeed::PacketScanFeed(LidarChannel& channel, ipc::WakeEvent& data_event,
                               std::atomic<std::int64_t>* gather_until_ns)
    : channel_(channel), data_event_(data_event), gather_until_ns_(gather_until_ns) {}

void PacketScanFeed::take(core::Scan& scan, std::int64_t popped_ns) {
  channel_.take_scan(scan);
  scan.completed_ns = monotonic_ns();
  // Packets buffered during identification count as received when they are decoded.
  scan.popped_ns = std::max(popped_ns, scan.received_ns);
  packets_per_scan_ = packets_in_scan_;
  packets_in_scan_ = 0;
  const std::int64_t period_ns = scan.received_ns - std::exchange(last_received_ns_, scan.received_ns);
  const bool is_regular = period_ns > 0 && period_ns < kLongestPeriodNs;
  next_gather_until_ns_ =
      is_regular ? scan.received_ns + static_cast<std::int64_t>(kGatherShare * static_cast<double>(period_ns))
                 : 0;
}

Advance PacketScanFeed::advance() {
  if (has_scan_) return Advance::kScan;
  if (channel_.front() == nullptr) return Advance::kNothing;
  popped_ns_ = monotonic_ns();
  has_scan_ = channel_.decode_front();
  ++packets_in_scan_;
  return has_scan_ ? Advance::kScan : Advance::kDecoded;
}

bool PacketScanFeed::drain(core::Scan& scan) {
  Advance advanced = advance();
  while (advanced == Advance::kDecoded) advanced = advance();
  if (advanced == Advance::kNothing) return false;
  has_scan_ = false;
  take(scan, popped_ns_);
  return true;
}

/// Ends the last scan of the input; true if it is complete.
bool PacketScanFeed::end(core::Scan& scan) {
  if (std::exchange(finished_, true)) return false;
  const bool complete = channel_.finish_scan();
  if (complete) take(scan, monotonic_ns());
  channel_.report_status();
  return complete;
}

FeedState PacketScanFeed::poll(core::Scan& scan) {
  if (gather_until_ns_ != nullptr) gather_until_ns_->store(next_gather_until_ns_, std::memory_order_relaxed);
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
