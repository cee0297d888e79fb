#include "daemon/input/sender_selection.hpp"

#include "nilio/drivers/velodyne/packet.hpp"

#include <algorithm>

namespace nilio::daemon {

SenderSelection::Verdict SenderSelection::examine(const drivers::Packet& packet) {
  const bool is_data = drivers::is_data_packet(packet);
  if (sender_ == packet.sender_address) {
    if (is_data) last_heard_ = packet.stamp;
    return Verdict::kOwn;
  }
  // The host's clock may have been set back.
  last_heard_ = std::min(last_heard_, packet.stamp);
  const Verdict refused = sender_ ? Verdict::kForeign : Verdict::kUndecided;
  if (!is_data) return refused;
  Candidate& candidate = candidate_of(packet);
  ++candidate.packets;
  ++candidate.in_window;
  const bool is_free = !sender_ || packet.stamp - last_heard_ >= kSilence;
  if (candidate.in_window < kSteadyPackets || !is_free) return refused;
  select(packet.sender_address, packet.stamp);
  return Verdict::kSelected;
}

bool SenderSelection::finish() {
  if (sender_) return true;
  const auto end = candidates_.begin() + static_cast<std::ptrdiff_t>(used_);
  const auto most = std::max_element(
      candidates_.begin(), end, [](const Candidate& a, const Candidate& b) { return a.packets < b.packets; });
  if (most == end) return false;
  select(most->address, most->window_start);
  return true;
}

bool SenderSelection::is_first_of(std::uint32_t foreign_address) {
  const auto end = reported_.begin() + static_cast<std::ptrdiff_t>(reports_);
  if (reports_ == kReports || std::find(reported_.begin(), end, foreign_address) != end) return false;
  reported_[reports_++] = foreign_address;
  return true;
}

/// The sender's entry, with its window up to date; a new sender replaces the one not heard for longest.
SenderSelection::Candidate& SenderSelection::candidate_of(const drivers::Packet& packet) {
  const auto end = candidates_.begin() + static_cast<std::ptrdiff_t>(used_);
  auto found = std::find_if(candidates_.begin(), end, [&packet](const Candidate& candidate) {
    return candidate.address == packet.sender_address;
  });
  if (found == end) {
    if (used_ < kCandidates) {
      ++used_;
    } else {
      found = std::min_element(
          candidates_.begin(), candidates_.end(),
          [](const Candidate& a, const Candidate& b) { return a.last_heard < b.last_heard; });
    }
    *found = {packet.sender_address, packet.stamp, packet.stamp, 0, 0};
  }
  found->last_heard = packet.stamp;
  const core::Duration age = packet.stamp - found->window_start;
  if (age < core::Duration{} || age > kWindow) {
    found->window_start = packet.stamp;
    found->in_window = 0;
  }
  return *found;
}

void SenderSelection::select(std::uint32_t address, core::Time stamp) {
  sender_ = address;
  last_heard_ = stamp;
  used_ = 0;
}

}  // namespace nilio::daemon
