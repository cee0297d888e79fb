#pragma once

#include "nilio/core/time.hpp"

#include "ipc/dds/odometry_publisher.hpp"
#include "ipc/dds/reports.hpp"
#include "ipc/histogram.hpp"
#include "ipc/messages/diagnostics.hpp"
#include "ipc/publisher_state.hpp"
#include "ipc/records.hpp"
#include "ipc/ring.hpp"
#include "ipc/shared_object.hpp"
#include "ipc/wake_event.hpp"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <thread>

namespace nilio::dds {

/// Latency histograms of the scan poses, up to the return of write().
class PublishLatency {
 public:
  void record(const ipc::PoseRecord& record, core::Time taken, core::Time written) noexcept;
  /// Number of report rows. The map stage is omitted: it happens after the pose has arrived here.
  static constexpr std::size_t kRows = ipc::kLatencyStageCount - 1 + 3;
  void fill(std::span<StageLatency, kRows> rows) const;

 private:
  ipc::LatencyHistograms stages_;
  ipc::Histogram pick_up_;
  ipc::Histogram write_;
  ipc::Histogram received_to_written_;
};

/// Shared memory of the scan pose thread with niliod.
struct ScanPoseInputs {
  ipc::Ring<ipc::PoseRecord> poses;
  ipc::WakeEvent wake;
  ipc::SharedObject<ipc::PublisherState> state;
};

/// Thread from the pose ring to DDS: pose, transform and scan report of every scan. It sends from write(),
/// and neither logs nor touches files, so that no other thread and no disk delays a pose. A pose is consumed
/// after it is written; a restarted process repeats an unfinished one.
class ScanPoseLoop {
 public:
  struct Counts {
    std::uint64_t published = 0;
    std::uint64_t failed_writes = 0;
    std::uint64_t ring_dropped = 0;
    std::uint64_t ring_high_water = 0;
  };
  struct Latest {
    ipc::PoseRecord record;
    core::Time taken;   ///< CLOCK_MONOTONIC
    PoseCounts counts;  ///< since the start of this process
  };

  /// `publisher` must outlive the loop; its scan pose writers belong to this thread.
  ScanPoseLoop(ScanPoseInputs inputs, OdometryPublisher& publisher);
  /// Stops the thread.
  ~ScanPoseLoop();
  ScanPoseLoop(const ScanPoseLoop&) = delete;
  ScanPoseLoop& operator=(const ScanPoseLoop&) = delete;

  /// Starts the thread. It calls `prepare` first, which requests its priority, and then waits up to
  /// `wait_for_subscribers` for a subscriber before it empties the ring.
  void start(std::function<void()> prepare, core::Duration wait_for_subscribers);
  /// Publishes the remaining content of the ring and ends the thread.
  void stop();

  // Any thread.
  [[nodiscard]] Counts counts() const;
  [[nodiscard]] std::optional<Latest> latest() const;
  [[nodiscard]] const PublishLatency& latency() const { return *latency_; }
  /// True once the wait for a first subscriber has ended.
  [[nodiscard]] bool has_started() const { return started_.load(std::memory_order_acquire); }

 private:
  void run(core::Duration wait_for_subscribers);
  void wait_for_first_subscriber(core::Duration wait);
  bool is_first_pose_delivered();
  void publish_pending();
  void publish(const ipc::PoseRecord& record);

  ScanPoseInputs inputs_;
  OdometryPublisher& publisher_;
  const std::string host_id_ = read_host_id();
  std::unique_ptr<PublishLatency> latency_;
  // Of the thread.
  ipc::OdometryResetDetector resets_;
  PoseCounts pose_counts_;
  mutable std::mutex latest_mutex_;
  std::optional<Latest> latest_;
  std::atomic<std::uint64_t> published_{0};
  std::atomic<std::uint64_t> failed_{0};
  std::atomic<bool> started_{false};
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace nilio::dds
