#pragma once

#include "nilio/core/se3.hpp"

#include "daemon/input/lidar_channel.hpp"
#include "daemon/input/scan_feed.hpp"
#include "daemon/odometry/decision_log.hpp"
#include "daemon/output/event_log.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace nilio::daemon {

/// What became of the points of a LiDAR that is merged into the scans of another.
struct MergeCounters {
  std::uint64_t points_merged = 0;
  /// Fired before the scans that they could have been in had begun, or long after: their packets came too
  /// late, the first LiDAR's scans had gaps, or the clocks do not agree.
  std::uint64_t points_unused = 0;
  /// Scans to which this LiDAR contributed nothing.
  std::uint64_t scans_without = 0;
  /// Live: scans that went on before its packets had come.
  std::uint64_t waits_timed_out = 0;
};

/// Scans of a first LiDAR with the points of others that were fired meanwhile: after the end of its scan
/// before, up to the end of this one. They are put into the first one's frame; time offsets count from the
/// start of its scan and may be a little negative. A LiDAR's packets are taken up to the first one that was
/// received more than 5 ms after the packet that completed the scan, by their stamps, so that a recording
/// always gives the same. Live, one that is late is waited for as long as it is configured, then left out;
/// one that is silent is not waited for at all.
class MergedScanFeed : public ScanFeed {
 public:
  struct Other {
    /// Has to outlive the feed.
    LidarChannel* channel = nullptr;
    core::SE3 T_first_other;
    float elevation_correction_rad = 0.0F;
    core::Duration wait;
    /// Points that there is to be room for from the beginning: of one of its longest scans.
    std::size_t capacity = 0;
  };
  struct Options {
    bool live = false;
    /// Of the first LiDAR; the odometry must not apply it to merged scans again.
    float elevation_correction_rad = 0.0F;
    /// Of an earlier run, in place of `live`; null = none. They have to outlive the feed.
    const std::vector<ScanDecision>* decisions = nullptr;
  };

  /// The references have to outlive the feed.
  MergedScanFeed(PacketScanFeed& first, const std::vector<Other>& others, const Options& options,
                 ipc::WakeEvent& data_event, FeedLog& log);

  FeedState next(core::Scan& scan, core::Duration timeout) override;
  [[nodiscard]] std::size_t waiting_scans() const override { return first_.waiting_scans(); }
  [[nodiscard]] MergeDecision merge_decision() const override { return decision_; }
  [[nodiscard]] drivers::ScanAssemblerStats stats() const override { return first_.stats(); }
  /// Of the other LiDAR `index`. Only while next() is not running.
  [[nodiscard]] const MergeCounters& counters(std::size_t index) const { return lanes_[index].counters; }

 private:
  /// A point in the first LiDAR's frame and when it was fired.
  struct TimedPoint {
    core::Time time;
    core::Point point;
  };
  enum class Presence { kPresent, kLate, kSilent };
  struct Lane {
    Other other;
    /// Added to the ranks of its beams, so that no two LiDARs' are the same.
    std::uint16_t first_ring = 0;
    /// What its assembler hands out.
    core::Scan part;
    std::vector<TimedPoint> pending;
    MergeCounters counters;
    /// Of the last points it gave.
    core::Time last_end;
    Presence presence = Presence::kPresent;
    std::uint32_t late_scans = 0;
    /// Packets that had come when the scan before was merged.
    std::uint64_t come_before = 0;
    bool offset_said = false;
    std::uint32_t scans_out_of_step = 0;
  };
  enum class Gathered { kAll, kEnded, kTooLate, kUnknown };
  /// Times of the points that belong to a scan: after `after`, up to `end`.
  struct Interval {
    core::Time after;
    core::Time end;
  };
  /// The scan that the others are merged into.
  struct Target {
    core::Scan& scan;
    Interval interval;
    /// Packets up to this stamp may be of it.
    core::Time until;
  };

  void keep_up(Lane& lane);
  void merge(core::Scan& scan);
  /// What an earlier run decided about this scan; null when there is none, or it does not say.
  [[nodiscard]] const MergeDecision* decision_about(const core::Scan& scan);
  Gathered gather(Lane& lane, const Target& target);
  Gathered repeat(Lane& lane, std::uint64_t packets, const Target& target);
  bool decode(Lane& lane, const Target& target);
  void take_points(Lane& lane, const Target& target);
  std::size_t move_points(Lane& lane, const Target& target);
  void report(const Lane& lane, FeedEvent::Kind kind, double offset_s = 0.0);
  void report_presence(Lane& lane, Gathered gathered, bool has_packets);
  void report_step(Lane& lane, std::size_t moved, bool has_packets, core::Time end);

  PacketScanFeed& first_;
  std::vector<Lane> lanes_;
  Options options_;
  ipc::WakeEvent& data_event_;
  FeedLog& log_;
  std::optional<core::Time> previous_end_;
  MergeDecision decision_;
  /// Of the decisions to be repeated.
  std::size_t next_decision_ = 0;
};

}  // namespace nilio::daemon
