#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"

#include "daemon/input/lidar_channel.hpp"
#include "daemon/odometry/decision_log.hpp"
#include "ipc/wake_event.hpp"

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

namespace nilio::daemon {

enum class FeedState { kScan, kIdle, kEnd };

/// Result of ScanFeed::advance().
enum class Advance {
  kDecoded,  ///< a packet behind the last scan was decoded
  kNothing,  ///< no packet waits
  kScan,     ///< the next scan is complete; nothing is decoded before it is taken
};

/// Source of complete scans for the odometry thread: packets as they arrive, or a data set of scans.
class ScanFeed {
 public:
  ScanFeed() = default;
  ScanFeed(const ScanFeed&) = delete;
  ScanFeed& operator=(const ScanFeed&) = delete;
  virtual ~ScanFeed() = default;

  /// Fills `scan` (its buffer is reused); kIdle if none was complete within the timeout.
  virtual FeedState next(core::Scan& scan, core::Duration timeout) = 0;
  /// Decodes one packet behind the last scan from next(), for the IMU samples in it. kNothing for feeds
  /// without packets.
  virtual Advance advance() { return Advance::kNothing; }
  /// Switches to paced replay with the first scan due at `start_ns` (CLOCK_MONOTONIC). Packet feeds are paced
  /// by their receive thread instead.
  virtual void set_pace(std::int64_t /*start_ns*/) {}
  /// Complete scans that wait behind the last scan from next().
  [[nodiscard]] virtual std::size_t waiting_scans() const { return 0; }
  /// Merge decision of the last scan from next().
  [[nodiscard]] virtual MergeDecision merge_decision() const { return {}; }
  /// Only while next() is not running.
  [[nodiscard]] virtual drivers::ScanAssemblerStats stats() const { return {}; }
  /// Lines about parts of a recording that were skipped, at its end.
  [[nodiscard]] virtual std::vector<std::string> skipped() const { return {}; }
};

/// Decodes one LiDAR's packets and cuts them into scans while they arrive.
class PacketScanFeed : public ScanFeed {
 public:
  /// The references must outlive the feed. `gather_until_ns`: written for the receive threads whenever this
  /// thread has time to wait for the next scan, see ReceivePolicy; may be null.
  PacketScanFeed(LidarChannel& channel, ipc::WakeEvent& data_event,
                 std::atomic<std::int64_t>* gather_until_ns = nullptr);

  FeedState next(core::Scan& scan, core::Duration timeout) override;
  /// As next() without waiting.
  FeedState poll(core::Scan& scan);
  Advance advance() override;
  [[nodiscard]] std::size_t waiting_scans() const override;
  [[nodiscard]] drivers::ScanAssemblerStats stats() const override { return channel_.stats(); }
  /// Stamp of the packet that completed the last scan.
  [[nodiscard]] core::Time last_stamp() const { return channel_.last_stamp(); }

 private:
  bool drain(core::Scan& scan);
  bool end(core::Scan& scan);
  void take(core::Scan& scan, std::int64_t popped_ns);

  LidarChannel& channel_;
  ipc::WakeEvent& data_event_;
  std::atomic<std::int64_t>* gather_until_ns_;
  /// Receive time of the last scan's last packet, and until when packets may gather behind it.
  std::int64_t last_received_ns_ = 0;
  std::int64_t next_gather_until_ns_ = 0;
  /// advance() has completed a scan.
  bool has_scan_ = false;
  std::int64_t popped_ns_ = 0;
  std::uint64_t packets_in_scan_ = 0;
  std::uint64_t packets_per_scan_ = 0;
  bool finished_ = false;
};

}  // namespace nilio::daemon
