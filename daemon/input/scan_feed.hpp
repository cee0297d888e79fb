#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"

#include "daemon/input/lidar_channel.hpp"
#include "daemon/odometry/decision_log.hpp"
#include "ipc/wake_event.hpp"

#include <cstdint>

namespace nilio::daemon {

enum class FeedState { kScan, kIdle, kEnd };

/// Where the odometry thread gets complete scans from: packets as they arrive, or a data set whose scans are
/// already cut.
class ScanFeed {
 public:
  ScanFeed() = default;
  ScanFeed(const ScanFeed&) = delete;
  ScanFeed& operator=(const ScanFeed&) = delete;
  virtual ~ScanFeed() = default;

  /// Fills `scan` (its buffer is reused); kIdle when none was complete within the timeout.
  virtual FeedState next(core::Scan& scan, core::Duration timeout) = 0;
  /// From now on scans become due at their own pace, the first at `start_ns` (CLOCK_MONOTONIC). Feeds of
  /// packets are paced by their receive thread instead.
  virtual void set_pace(std::int64_t /*start_ns*/) {}
  /// Whole scans that wait behind the one that next() gave last.
  [[nodiscard]] virtual std::size_t waiting_scans() const { return 0; }
  /// About the scan that next() gave last.
  [[nodiscard]] virtual MergeDecision merge_decision() const { return {}; }
  /// Only while next() is not running.
  [[nodiscard]] virtual drivers::ScanAssemblerStats stats() const { return {}; }
};

/// Decodes and cuts one LiDAR's packets while they arrive.
class PacketScanFeed : public ScanFeed {
 public:
  /// Both have to outlive the feed.
  PacketScanFeed(LidarChannel& channel, ipc::WakeEvent& data_event);

  FeedState next(core::Scan& scan, core::Duration timeout) override;
  /// As next() without waiting.
  FeedState poll(core::Scan& scan);
  [[nodiscard]] std::size_t waiting_scans() const override;
  [[nodiscard]] drivers::ScanAssemblerStats stats() const override { return channel_.stats(); }
  /// Of the packet that completed the last scan.
  [[nodiscard]] core::Time last_stamp() const { return channel_.last_stamp(); }

 private:
  bool drain(core::Scan& scan);
  bool end(core::Scan& scan);
  void take(core::Scan& scan);

  LidarChannel& channel_;
  ipc::WakeEvent& data_event_;
  std::uint64_t packets_in_scan_ = 0;
  std::uint64_t packets_per_scan_ = 0;
  bool finished_ = false;
};

}  // namespace nilio::daemon
