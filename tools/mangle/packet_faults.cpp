#include "tools/mangle/packet_faults.hpp"

#include <cmath>
#include <utility>

namespace nilio::tools::mangle {

namespace {

// Streams of random numbers, so that one fault does not change the packets of another.
constexpr std::uint64_t kLosses = 101;
constexpr std::uint64_t kBursts = 102;
constexpr std::uint64_t kDuplicates = 103;
constexpr std::uint64_t kOrders = 104;

}  // namespace

core::Duration clock_error(const Faults& faults, core::Time begin, core::Time stamp) {
  core::Duration error{};
  for (const TimedFault& step : faults.clock_steps) {
    if ((stamp - begin).seconds() >= step.at_s) error = error + core::Duration::from_seconds(step.amount_s);
  }
  return error;
}

PacketFaults::PacketFaults(const Faults& faults, core::Time begin)
    : faults_(faults),
      begin_(begin),
      losses_(faults.seed, kLosses),
      bursts_(faults.seed, kBursts),
      duplicates_(faults.seed, kDuplicates),
      orders_(faults.seed, kOrders),
      lost_in_gap_(faults.gaps.size(), 0) {
  schedule_burst(0.0);
}

/// Intervals of a Poisson process.
void PacketFaults::schedule_burst(double after_s) {
  if (faults_.burst)
    next_burst_s_ = after_s - faults_.burst->period_s * std::log(1.0 - bursts_.uniform(0.0, 1.0));
}

bool PacketFaults::is_in_gap(double seconds) {
  for (std::size_t i = 0; i < faults_.gaps.size(); ++i) {
    const TimedFault& gap = faults_.gaps[i];
    if (seconds < gap.at_s || seconds >= gap.at_s + gap.amount_s) continue;
    ++lost_in_gap_[i];
    return true;
  }
  return false;
}

bool PacketFaults::is_in_burst(double seconds) {
  if (!faults_.burst) return false;
  if (left_in_burst_ == 0 && seconds >= next_burst_s_) {
    left_in_burst_ = faults_.burst->count;
    schedule_burst(seconds);
  }
  if (left_in_burst_ == 0) return false;
  --left_in_burst_;
  return true;
}

bool PacketFaults::is_lost(const drivers::Packet& packet) {
  const double seconds = (packet.stamp - begin_).seconds();
  if (is_in_gap(seconds)) return ++counts_.lost_in_gaps > 0;
  if (is_in_burst(seconds)) return ++counts_.lost_in_bursts > 0;
  if (faults_.loss > 0.0 && losses_.chance(faults_.loss)) return ++counts_.lost > 0;
  return false;
}

void PacketFaults::deliver(drivers::Packet packet, std::vector<drivers::Packet>& out) {
  const core::Duration error = clock_error(faults_, begin_, packet.stamp);
  if (error.ns != 0) ++counts_.restamped;
  packet.stamp = packet.stamp + error;
  out.push_back(packet);
  ++counts_.written;
  if (faults_.duplicate <= 0.0 || !duplicates_.chance(faults_.duplicate)) return;
  out.push_back(packet);
  ++counts_.written;
  ++counts_.duplicated;
}

void PacketFaults::add(const drivers::Packet& packet, std::vector<drivers::Packet>& out) {
  ++counts_.packets;
  if (is_lost(packet)) return;
  if (held_) {
    // Receive times stay in order: the two change their contents.
    drivers::Packet first = packet;
    first.stamp = std::exchange(held_->stamp, packet.stamp);
    deliver(first, out);
    deliver(*held_, out);
    held_.reset();
    ++counts_.reordered;
  } else if (faults_.reorder > 0.0 && orders_.chance(faults_.reorder)) {
    held_ = packet;
  } else {
    deliver(packet, out);
  }
}

void PacketFaults::finish(std::vector<drivers::Packet>& out) {
  if (held_) deliver(*held_, out);
  held_.reset();
}

}  // namespace nilio::tools::mangle
