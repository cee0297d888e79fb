#include "daemon/input/merged_scan_feed.hpp"

#include "nilio/core/portable_math.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace nilio::daemon {

namespace {

using core::Duration;

// A packet's first firing is up to 1.4 ms older than its stamp, and the ports are read in turn.
constexpr Duration kReceiveSlack = Duration::from_milliseconds(5.0);
// Motion before a sweep is extrapolated from its start; the error grows with time.
constexpr Duration kMaxSeam = Duration::from_milliseconds(100.0);
// Points farther ahead than this come from an unsynchronized clock.
constexpr Duration kMaxAhead = Duration::from_seconds(1.0);
// One second at 10 Hz without a synchronized point.
constexpr std::uint32_t kScansToReportOffset = 10;
// Exceeds the number of rings of every model.
constexpr std::size_t kRingsOfLidar = 256;
// The first scan after a LiDAR fell silent contains part of its packets.
constexpr std::uint32_t kScansToReportLate = 3;
// Points after a scan's end are kept for the next one; two scans of points are rarely exceeded.
constexpr std::size_t kScansPending = 2;
constexpr Duration kWakePeriod = Duration::from_milliseconds(5.0);

/// Rotates a point upwards about the horizontal axis perpendicular to its direction.
core::Vector3 raise_beam(const core::Vector3& p, double angle_rad) {
  const double horizontal = p.head<2>().norm();
  if (horizontal == 0.0) return p;
  const double cosine = portable::cos(angle_rad);
  const double sine = portable::sin(angle_rad);
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
                               const Options& options, ipc::WakeEvent& data_event, EventLog& log)
    : first_(first), options_(options), data_event_(data_event), log_(log) {
  for (const Other& other : others) {
    MergedLidar lidar;
    lidar.other = other;
    lidar.ring_offset = static_cast<std::uint16_t>(kRingsOfLidar * (lidars_.size() + 1));
    lidar.pending.reserve(kScansPending * lidar.other.capacity);
    lidars_.push_back(std::move(lidar));
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
      for (MergedLidar& lidar : lidars_) lidar.other.channel->report_status();
      return state;
    }
    if (options_.rules.are_live()) {
      for (MergedLidar& lidar : lidars_) discard_outdated(lidar);
    }
    if (!data_event_.wait(timeout)) return FeedState::kIdle;
  }
}

/// Discards outdated packets of the additional LiDARs while the first LiDAR delivers no scans.
void MergedScanFeed::discard_outdated(MergedLidar& lidar) {
  LidarChannel& channel = *lidar.other.channel;
  if (!channel.is_identified() && channel.front() == nullptr) return;
  while (channel.packets_waiting() > channel.ring_capacity() / 2 && channel.front() != nullptr) {
    if (!channel.decode_front()) continue;
    channel.take_scan(lidar.part);
    lidar.counters.points_unused += lidar.part.points.size();
  }
}

const MergeDecision* MergedScanFeed::recorded_decision(const core::Scan& scan) {
  if (options_.decisions == nullptr) return nullptr;
  const std::vector<ScanDecision>& decisions = *options_.decisions;
  while (next_decision_ < decisions.size() && decisions[next_decision_].sequence < scan.sequence)
    ++next_decision_;
  if (next_decision_ == decisions.size() || decisions[next_decision_].sequence != scan.sequence)
    return nullptr;
  const ScanDecision& decision = decisions[next_decision_];
  // A decision log without merge decisions cannot be replayed.
  return decision.merge.merged || decision.superseded ? &decision.merge : nullptr;
}

void MergedScanFeed::merge(core::Scan& scan) {
  const core::Time earliest = scan.start - kMaxSeam;
  const Target target{
      scan,
      {previous_end_ ? std::max(*previous_end_, earliest) : scan.start - Duration{1}, scan.end},
      first_.last_stamp() + kReceiveSlack};
  previous_end_ = scan.end;
  const MergeDecision* const earlier = recorded_decision(scan);
  decision_ = {};
  // A scan that is about to be superseded does not wait.
  if (earlier != nullptr ? !earlier->merged : options_.rules.are_live() && first_.waiting_scans() > 0) return;
  decision_.merged = true;
  if (options_.elevation_correction_rad != 0.0F) {
    for (core::Point& point : scan.points) {
      const core::Vector3 p(point.x, point.y, point.z);
      store(raise_beam(p, static_cast<double>(options_.elevation_correction_rad)), point);
    }
  }
  for (MergedLidar& lidar : lidars_) {
    LidarChannel& channel = *lidar.other.channel;
    const std::uint64_t taken_before = channel.packets_taken();
    const std::uint8_t index = decision_.lidars++;
    const Gathered gathered = earlier != nullptr && index < earlier->lidars
                                  ? repeat(lidar, earlier->packets[index], target)
                                  : gather(lidar, target);
    if (channel.is_identified()) decision_.packets[index] = channel.packets_passed();
    // Packets of an unidentified LiDAR are buffered; their arrival counts as presence.
    const std::uint64_t received = channel.packets_taken() + channel.packets_in_ring();
    const bool is_being_identified = gathered == Gathered::kUnknown && received > lidar.received_before;
    lidar.received_before = received;
    const bool has_packets = channel.packets_taken() > taken_before || is_being_identified;
    const std::size_t moved = move_points(lidar, target);
    if (moved == 0) ++lidar.counters.scans_without;
    report_presence(lidar, gathered, has_packets);
    report_step(lidar, moved, has_packets, scan.end);
  }
}

/// Decodes packets up to the first one after the scan, as far as they are there or arrive in time.
MergedScanFeed::Gathered MergedScanFeed::gather(MergedLidar& lidar, const Target& target) {
  LidarChannel& channel = *lidar.other.channel;
  const std::int64_t deadline_ns = target.scan.completed_ns + lidar.other.wait.ns;
  const std::uint64_t taken_before = channel.packets_taken();
  while (true) {
    const bool ended = channel.ended();
    const bool is_whole = decode(lidar, target);
    if (is_whole || ended) {
      if (channel.finish_scan()) take_points(lidar, target);
      return is_whole ? Gathered::kAll : Gathered::kEnded;
    }
    if (!options_.rules.are_live()) {
      data_event_.wait(kWakePeriod);
      continue;
    }
    if (!channel.is_identified()) return Gathered::kUnknown;
    const Duration left{deadline_ns - monotonic_ns()};
    const bool is_silent = lidar.presence == Presence::kSilent && channel.packets_taken() == taken_before;
    // Waiting further would only get this scan superseded.
    if (is_silent || left <= Duration{} || first_.waiting_scans() > 0) {
      if (!is_silent) ++lidar.counters.waits_timed_out;
      if (channel.finish_scan()) take_points(lidar, target);
      return Gathered::kTooLate;
    }
    data_event_.wait(std::min(left, kWakePeriod));
  }
}

/// Decodes as many packets as the recorded run had decoded at this scan.
MergedScanFeed::Gathered MergedScanFeed::repeat(MergedLidar& lidar, std::uint64_t packets,
                                                const Target& target) {
  LidarChannel& channel = *lidar.other.channel;
  while (!channel.is_identified() || channel.packets_passed() < packets) {
    const bool ended = channel.ended();
    if (channel.front() != nullptr) {
      if (channel.decode_front()) take_points(lidar, target);
    } else if (ended) {
      break;
    } else {
      data_event_.wait(kWakePeriod);
    }
  }
  if (packets > 0 && channel.finish_scan()) take_points(lidar, target);
  return Gathered::kAll;
}

/// Decodes packets up to target.until. Returns true if a later packet is there.
bool MergedScanFeed::decode(MergedLidar& lidar, const Target& target) {
  LidarChannel& channel = *lidar.other.channel;
  for (const drivers::Packet* packet = channel.front(); packet != nullptr; packet = channel.front()) {
    if (packet->stamp > target.until) return true;
    if (channel.decode_front()) take_points(lidar, target);
  }
  return false;
}

/// Transforms the assembler's points into the frame of the first LiDAR.
void MergedScanFeed::take_points(MergedLidar& lidar, const Target& target) {
  lidar.other.channel->take_scan(lidar.part);
  target.scan.lost_packets += lidar.part.lost_packets;
  target.scan.missing_firings += lidar.part.missing_firings;
  lidar.last_end = lidar.part.end;
  for (core::Point point : lidar.part.points) {
    const core::Time time = lidar.part.start + Duration{point.time_offset_ns};
    // Outdated points are dropped: they would fill the buffer while the first LiDAR is silent.
    if (time <= target.interval.after) {
      ++lidar.counters.points_unused;
      continue;
    }
    core::Vector3 p(point.x, point.y, point.z);
    if (lidar.other.elevation_correction_rad != 0.0F)
      p = raise_beam(p, static_cast<double>(lidar.other.elevation_correction_rad));
    store(lidar.other.T_first_other * p, point);
    point.ring = static_cast<std::uint16_t>(point.ring + lidar.ring_offset);
    lidar.pending.push_back({time, point});
  }
}

/// Moves the points of the scan's interval into it and keeps later ones.
std::size_t MergedScanFeed::move_points(MergedLidar& lidar, const Target& target) {
  const Interval& interval = target.interval;
  std::size_t moved = 0;
  std::size_t kept = 0;
  for (TimedPoint& timed : lidar.pending) {
    if (timed.time > interval.after && timed.time <= interval.end) {
      timed.point.time_offset_ns = static_cast<std::int32_t>((timed.time - target.scan.start).ns);
      target.scan.points.push_back(timed.point);
      ++moved;
    } else if (timed.time > interval.end && timed.time <= interval.end + kMaxAhead) {
      lidar.pending[kept++] = timed;
    } else {
      ++lidar.counters.points_unused;
    }
  }
  lidar.pending.resize(kept);
  lidar.counters.points_merged += moved;
  return moved;
}

void MergedScanFeed::report(const MergedLidar& lidar, LidarEvent::Kind kind, double offset_s) {
  LidarEvent event;
  event.kind = kind;
  copy_name(lidar.other.channel->section(), event.section);
  event.offset_s = offset_s;
  log_.report(event);
}

/// Reports when a LiDAR becomes late or silent, and when it recovers.
void MergedScanFeed::report_presence(MergedLidar& lidar, Gathered gathered, bool has_packets) {
  const Presence before = lidar.presence;
  lidar.late_scans = gathered == Gathered::kTooLate ? lidar.late_scans + 1 : 0;
  if (!has_packets) {
    lidar.presence = Presence::kSilent;
    if (before != Presence::kSilent) report(lidar, LidarEvent::Kind::kSilent);
  } else if (lidar.late_scans >= kScansToReportLate && before == Presence::kPresent) {
    lidar.presence = Presence::kLate;
    report(lidar, LidarEvent::Kind::kLate);
  } else if (gathered == Gathered::kAll && before != Presence::kPresent) {
    lidar.presence = Presence::kPresent;
    report(lidar, LidarEvent::Kind::kRecovered);
  }
}

/// Reports a clock offset if points never fall into the scans.
void MergedScanFeed::report_step(MergedLidar& lidar, std::size_t moved, bool has_packets, core::Time end) {
  const bool out_of_step = moved == 0 && has_packets && lidar.last_end.ns != 0;
  lidar.scans_out_of_step = out_of_step ? lidar.scans_out_of_step + 1 : 0;
  if (lidar.scans_out_of_step < kScansToReportOffset || std::exchange(lidar.offset_reported, true)) return;
  report(lidar, LidarEvent::Kind::kOtherClock, (lidar.last_end - end).seconds());
}

}  // namespace nilio::daemon
