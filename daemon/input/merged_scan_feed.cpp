#include "daemon/input/merged_scan_feed.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace nilio::daemon {

namespace {

using core::Duration;

// A packet's first firing is up to 1.4 ms older than its stamp, and ports are read in turns.
constexpr Duration kReceiveSlack = Duration::from_milliseconds(5.0);
// The motion before a sweep is extrapolated from its beginning, which goes wrong with time.
constexpr Duration kLongestSeam = Duration::from_milliseconds(100.0);
// Points farther ahead than this were fired by another clock.
constexpr Duration kFarthestAhead = Duration::from_seconds(1.0);
// A second without one point in step is no accident.
constexpr std::uint32_t kScansToSayOffset = 10;
// More than any model has.
constexpr std::size_t kRingsOfLidar = 256;
// Half a ring.
constexpr std::size_t kMostWaiting = 2048;
// The first scan after a LiDAR fell silent has a part of its packets.
constexpr std::uint32_t kScansToSayLate = 3;
// What comes after a scan's end is kept until the next one: seldom more than what came during one.
constexpr std::size_t kScansPending = 2;
constexpr Duration kWakePeriod = Duration::from_milliseconds(5.0);

/// Turns a point about the horizontal axis across its direction, upwards.
core::Vector3 raise_beam(const core::Vector3& p, double angle_rad) {
  const double horizontal = p.head<2>().norm();
  if (horizontal == 0.0) return p;
  const double cosine = std::cos(angle_rad);
  const double sine = std::sin(angle_rad);
  const double shrink = cosine - p.z() / horizontal * sine;
  return {p.x() * shrink, p.y() * shrink, p.z() * cosine + horizontal * sine};
}

void store(const core::Vector3& position, core::Point& point) {
  point.x = static_cast<float>(position.x());
  point.y = static_cast<float>(position.y());
  point.z = static_cast<float>(position.z());
}

}  // namespace

MergedScanFeed::MergedScanFeed(PacketScanFeed& first, const std::vector<Other>& others,
                               const Options& options, ipc::WakeEvent& data_event, FeedLog& log)
    : first_(first), options_(options), data_event_(data_event), log_(log) {
  for (const Other& other : others) {
    Lane lane;
    lane.other = other;
    lane.first_ring = static_cast<std::uint16_t>(kRingsOfLidar * (lanes_.size() + 1));
    lane.pending.reserve(kScansPending * lane.other.capacity);
    lanes_.push_back(std::move(lane));
  }
}

FeedState MergedScanFeed::next(core::Scan& scan, Duration timeout) {
  while (true) {
    const FeedState state = first_.poll(scan);
    if (state == FeedState::kScan) {
      merge(scan);
      return state;
    }
    if (state == FeedState::kEnd) {
      for (Lane& lane : lanes_) lane.other.channel->report_status();
      return state;
    }
    if (options_.live) {
      for (Lane& lane : lanes_) keep_up(lane);
    }
    if (!data_event_.wait(timeout)) return FeedState::kIdle;
  }
}

/// While the first LiDAR gives no scans, those beside it are looked at, and what is too old is thrown away.
void MergedScanFeed::keep_up(Lane& lane) {
  LidarChannel& channel = *lane.other.channel;
  if (!channel.is_known() && channel.front() == nullptr) return;
  while (channel.packets_waiting() > kMostWaiting && channel.front() != nullptr) {
    if (!channel.decode_front()) continue;
    channel.take_scan(lane.part);
    lane.counters.points_unused += lane.part.points.size();
  }
}

const MergeDecision* MergedScanFeed::decision_about(const core::Scan& scan) {
  if (options_.decisions == nullptr) return nullptr;
  const std::vector<ScanDecision>& decisions = *options_.decisions;
  while (next_decision_ < decisions.size() && decisions[next_decision_].sequence < scan.sequence)
    ++next_decision_;
  if (next_decision_ == decisions.size() || decisions[next_decision_].sequence != scan.sequence)
    return nullptr;
  const ScanDecision& decision = decisions[next_decision_];
  // Of a log that says nothing of the other LiDARs nothing can be repeated.
  return decision.merge.merged || decision.superseded ? &decision.merge : nullptr;
}

void MergedScanFeed::merge(core::Scan& scan) {
  const core::Time earliest = scan.start - kLongestSeam;
  const Target target{
      scan,
      {previous_end_ ? std::max(*previous_end_, earliest) : scan.start - Duration{1}, scan.end},
      first_.last_stamp() + kReceiveSlack};
  previous_end_ = scan.end;
  const MergeDecision* const earlier = decision_about(scan);
  decision_ = {};
  // A scan that is about to be superseded does not wait.
  if (earlier != nullptr ? !earlier->merged : options_.live && first_.waiting_scans() > 0) return;
  decision_.merged = true;
  if (options_.elevation_correction_rad != 0.0F) {
    for (core::Point& point : scan.points) {
      const core::Vector3 p(point.x, point.y, point.z);
      store(raise_beam(p, static_cast<double>(options_.elevation_correction_rad)), point);
    }
  }
  for (Lane& lane : lanes_) {
    LidarChannel& channel = *lane.other.channel;
    const std::uint64_t taken_before = channel.packets_taken();
    const std::uint8_t index = decision_.lidars++;
    const Gathered gathered = earlier != nullptr && index < earlier->lidars
                                  ? repeat(lane, earlier->packets[index], target)
                                  : gather(lane, target);
    if (channel.is_known()) decision_.packets[index] = channel.packets_passed();
    // Of one that is not known yet the packets are kept back: that they come is what counts.
    const std::uint64_t come = channel.packets_taken() + channel.packets_in_ring();
    const bool is_being_found = gathered == Gathered::kUnknown && come > lane.come_before;
    lane.come_before = come;
    const bool has_packets = channel.packets_taken() > taken_before || is_being_found;
    const std::size_t moved = move_points(lane, target);
    if (moved == 0) ++lane.counters.scans_without;
    report_presence(lane, gathered, has_packets);
    report_step(lane, moved, has_packets, scan.end);
  }
}

/// Takes packets until one is later than the scan's, as far as they are there or come in time.
MergedScanFeed::Gathered MergedScanFeed::gather(Lane& lane, const Target& target) {
  LidarChannel& channel = *lane.other.channel;
  const std::int64_t deadline_ns = target.scan.completed_ns + lane.other.wait.ns;
  const std::uint64_t taken_before = channel.packets_taken();
  while (true) {
    const bool ended = channel.ended();
    const bool is_whole = decode(lane, target);
    if (is_whole || ended) {
      if (channel.finish_scan()) take_points(lane, target);
      return is_whole ? Gathered::kAll : Gathered::kEnded;
    }
    if (!options_.live) {
      data_event_.wait(kWakePeriod);
      continue;
    }
    if (!channel.is_known()) return Gathered::kUnknown;
    const Duration left{deadline_ns - monotonic_ns()};
    const bool is_silent = lane.presence == Presence::kSilent && channel.packets_taken() == taken_before;
    // The scan would be superseded anyway once the next one is there.
    if (is_silent || left <= Duration{} || first_.waiting_scans() > 0) {
      if (!is_silent) ++lane.counters.waits_timed_out;
      if (channel.finish_scan()) take_points(lane, target);
      return Gathered::kTooLate;
    }
    data_event_.wait(std::min(left, kWakePeriod));
  }
}

/// Takes as many packets as an earlier run had by then.
MergedScanFeed::Gathered MergedScanFeed::repeat(Lane& lane, std::uint64_t packets, const Target& target) {
  LidarChannel& channel = *lane.other.channel;
  while (!channel.is_known() || channel.packets_passed() < packets) {
    const bool ended = channel.ended();
    if (channel.front() != nullptr) {
      if (channel.decode_front()) take_points(lane, target);
    } else if (ended) {
      break;
    } else {
      data_event_.wait(kWakePeriod);
    }
  }
  if (packets > 0 && channel.finish_scan()) take_points(lane, target);
  return Gathered::kAll;
}

/// True when a packet later than the scan's is there.
bool MergedScanFeed::decode(Lane& lane, const Target& target) {
  LidarChannel& channel = *lane.other.channel;
  for (const drivers::Packet* packet = channel.front(); packet != nullptr; packet = channel.front()) {
    if (packet->stamp > target.until) return true;
    if (channel.decode_front()) take_points(lane, target);
  }
  return false;
}

/// Puts the points of what the assembler completed into the first LiDAR's frame.
void MergedScanFeed::take_points(Lane& lane, const Target& target) {
  lane.other.channel->take_scan(lane.part);
  target.scan.lost_packets += lane.part.lost_packets;
  target.scan.missing_firings += lane.part.missing_firings;
  lane.last_end = lane.part.end;
  for (core::Point point : lane.part.points) {
    const core::Time time = lane.part.start + Duration{point.time_offset_ns};
    // Too old: kept, they would fill the buffer while the first LiDAR is silent.
    if (time <= target.interval.after) {
      ++lane.counters.points_unused;
      continue;
    }
    core::Vector3 p(point.x, point.y, point.z);
    if (lane.other.elevation_correction_rad != 0.0F)
      p = raise_beam(p, static_cast<double>(lane.other.elevation_correction_rad));
    store(lane.other.T_first_other * p, point);
    point.ring = static_cast<std::uint16_t>(point.ring + lane.first_ring);
    lane.pending.push_back({time, point});
  }
}

/// Moves what belongs to the scan there and keeps what comes after it.
std::size_t MergedScanFeed::move_points(Lane& lane, const Target& target) {
  const Interval& interval = target.interval;
  std::size_t moved = 0;
  std::size_t kept = 0;
  for (TimedPoint& timed : lane.pending) {
    if (timed.time > interval.after && timed.time <= interval.end) {
      timed.point.time_offset_ns = static_cast<std::int32_t>((timed.time - target.scan.start).ns);
      target.scan.points.push_back(timed.point);
      ++moved;
    } else if (timed.time > interval.end && timed.time <= interval.end + kFarthestAhead) {
      lane.pending[kept++] = timed;
    } else {
      ++lane.counters.points_unused;
    }
  }
  lane.pending.resize(kept);
  lane.counters.points_merged += moved;
  return moved;
}

void MergedScanFeed::report(const Lane& lane, FeedEvent::Kind kind, double offset_s) {
  FeedEvent event;
  event.kind = kind;
  copy_name(lane.other.channel->section(), event.section);
  event.offset_s = offset_s;
  log_.report(event);
}

/// Says when a LiDAR begins to be late or silent and when it is in time again.
void MergedScanFeed::report_presence(Lane& lane, Gathered gathered, bool has_packets) {
  const Presence before = lane.presence;
  lane.late_scans = gathered == Gathered::kTooLate ? lane.late_scans + 1 : 0;
  if (!has_packets) {
    lane.presence = Presence::kSilent;
    if (before != Presence::kSilent) report(lane, FeedEvent::Kind::kSilent);
  } else if (lane.late_scans >= kScansToSayLate && before == Presence::kPresent) {
    lane.presence = Presence::kLate;
    report(lane, FeedEvent::Kind::kLate);
  } else if (gathered == Gathered::kAll && before != Presence::kPresent) {
    lane.presence = Presence::kPresent;
    report(lane, FeedEvent::Kind::kInTimeAgain);
  }
}

/// Points that are never in step with the scans are of another clock.
void MergedScanFeed::report_step(Lane& lane, std::size_t moved, bool has_packets, core::Time end) {
  const bool out_of_step = moved == 0 && has_packets && lane.last_end.ns != 0;
  lane.scans_out_of_step = out_of_step ? lane.scans_out_of_step + 1 : 0;
  if (lane.scans_out_of_step < kScansToSayOffset || std::exchange(lane.offset_said, true)) return;
  report(lane, FeedEvent::Kind::kOtherClock, (lane.last_end - end).seconds());
}

}  // namespace nilio::daemon
