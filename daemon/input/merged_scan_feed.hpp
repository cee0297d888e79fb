#pragma once

#include "nilio/core/se3.hpp"

#include "daemon/input/lidar_channel.hpp"
#include "daemon/input/scan_feed.hpp"
#include "daemon/odometry/decision_log.hpp"
#include "daemon/output/event_log.hpp"
#include "daemon/realtime/run_rules.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace nilio::daemon {

/// Counters of a LiDAR that is merged into the scans of another one.
struct MergeCounters {
  std::uint64_t points_merged = 0;
  /// Points outside every scan's interval: late packets, gaps between the first LiDAR's scans, or
  /// unsynchronized clocks.
  std::uint64_t points_unused = 0;
  /// Scans without points of this LiDAR.
  std::uint64_t scans_without = 0;
  /// Live: scans that were processed before its packets arrived.
  std::uint64_t waits_timed_out = 0;
};

/// Scans of a first LiDAR with the points that the others fired between the end of its previous scan and the
/// end of this one. Points are in the first LiDAR's frame; time offsets count from the start of its scan and
/// may be slightly negative.
///
/// Packets are taken up to the first one received more than 5 ms after the packet that completed the scan, by
/// their stamps; a recording therefore gives the same result every time. Live, a late LiDAR is waited for up
/// to its configured time, a silent one not at all.
class MergedScanFeed : public ScanFeed {
 public:
  struct Other {
    /// Must outlive the feed.
    LidarChannel* channel = nullptr;
    core::SE3 T_first_other;
    float elevation_correction_rad = 0.0F;
    core::Duration wait;
    /// Points to reserve memory for: one of its longest scans.
    std::size_t capacity = 0;
  };
  struct Options {
    RunRules rules;
    /// Of the first LiDAR; the odometry must not apply it to merged scans again.
    float elevation_correction_rad = 0.0F;
    /// Decisions of an earlier run that replace the live rules; null = none. Must outlive the feed.
    const std::vector<ScanDecision>* decisions = nullptr;
  };

  /// All references must outlive the feed.
  MergedScanFeed(PacketScanFeed& first, const std::vector<Other>& others, const Options& options,
                 ipc::WakeEvent& data_event, EventLog& log);

  FeedState next(core::Scan& scan, core::Duration timeout) override;
  Advance advance() override { return first_.advance(); }
  [[nodiscard]] std::size_t waiting_scans() const override { return first_.waiting_scans(); }
  [[nodiscard]] MergeDecision merge_decision() const override { return decision_; }
  [[nodiscard]] drivers::ScanAssemblerStats stats() const override { return first_.stats(); }
  /// Counters of additional LiDAR `index`. Only while next() is not running.
  [[nodiscard]] const MergeCounters& counters(std::size_t index) const { return lidars_[index].counters; }

 private:
  /// Point in the first LiDAR's frame with its firing time.
  struct TimedPoint {
    core::Time time;
    core::Point point;
  };
  enum class Presence { kPresent, kLate, kSilent };
  struct MergedLidar {
    Other other;
    /// Offset of its ring numbers, so that those of different LiDARs differ.
    std::uint16_t ring_offset = 0;
    /// Partial scan from its assembler.
    core::Scan part;
    std::vector<TimedPoint> pending;
    MergeCounters counters;
    /// End of its last partial scan.
    core::Time last_end;
    Presence presence = Presence::kPresent;
    std::uint32_t late_scans = 0;
    /// Packets received when the previous scan was merged.
    std::uint64_t received_before = 0;
    bool offset_reported = false;
    std::uint32_t scans_out_of_step = 0;
  };
  enum class Gathered { kAll, kEnded, kTooLate, kUnknown };
  /// Firing times of a scan's points: after `after`, up to `end`.
  struct Interval {
    core::Time after;
    core::Time end;
  };
  /// Scan that the other LiDARs are merged into.
  struct Target {
    core::Scan& scan;
    Interval interval;
    /// Packets up to this stamp may belong to the scan.
    core::Time until;
  };

  void discard_outdated(MergedLidar& lidar);
  void merge(core::Scan& scan);
  /// Decision of the recorded run for this scan; null if there is none.
  [[nodiscard]] const MergeDecision* recorded_decision(const core::Scan& scan);
  Gathered gather(MergedLidar& lidar, const Target& target);
  Gathered repeat(MergedLidar& lidar, std::uint64_t packets, const Target& target);
  bool decode(MergedLidar& lidar, const Target& target);
  void take_points(MergedLidar& lidar, const Target& target);
  std::size_t move_points(MergedLidar& lidar, const Target& target);
  void report(const MergedLidar& lidar, LidarEvent::Kind kind, double offset_s = 0.0);
  void report_presence(MergedLidar& lidar, Gathered gathered, bool has_packets);
  void report_step(MergedLidar& lidar, std::size_t moved, bool has_packets, core::Time end);

  PacketScanFeed& first_;
  std::vector<MergedLidar> lidars_;
  Options options_;
  ipc::WakeEvent& data_event_;
  EventLog& log_;
  std::optional<core::Time> previous_end_;
  MergeDecision decision_;
  /// Index into the recorded decisions.
  std::size_t next_decision_ = 0;
};

}  // namespace nilio::daemon
