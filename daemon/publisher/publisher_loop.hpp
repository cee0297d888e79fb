#pragma once

#include "nilio/core/time.hpp"

#include "daemon/publisher/imu_pose_loop.hpp"
#include "ipc/dds/odometry_publisher.hpp"
#include "ipc/dds/reports.hpp"
#include "ipc/histogram.hpp"
#include "ipc/records.hpp"
#include "ipc/ring.hpp"
#include "ipc/wake_event.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <sys/types.h>

namespace nilio::daemon {

/// Latency histograms of the scan poses, up to the return of write().
class PublishLatency {
 public:
  void record(const ipc::PoseRecord& record, core::Time taken, core::Time written) noexcept;
  /// Number of report rows. The map stage is omitted: it happens after the pose has arrived here.
  static constexpr std::size_t kRows = ipc::kLatencyStageCount - 1 + 3;
  void fill(std::span<dds::StageLatency, kRows> rows) const;

 private:
  ipc::LatencyHistograms stages_;
  ipc::Histogram pick_up_;
  ipc::Histogram write_;
  ipc::Histogram received_to_written_;
};

/// Loop from the pose ring to DDS: scan poses, transforms and reports.
class PublisherLoop {
 public:
  /// Exit status that asks niliod to restart the process.
  static constexpr int kExitStartAgain = 75;  // EX_TEMPFAIL of sysexits.h

  /// `signals`: signalfd of the stop signals. `imu_poses` may be null. `parent`: end with this process; 0 =
  /// none.
  PublisherLoop(pid_t parent, ipc::Ring<ipc::PoseRecord> ring, ipc::WakeEvent wake_event, int signals,
                std::unique_ptr<dds::OdometryPublisher> publisher,
                std::unique_ptr<dds::ImuPoseLoop> imu_poses);

  /// Runs until a stop signal has arrived and the ring is empty. Returns the exit status.
  int run(core::Duration wait_for_subscribers);

 private:
  void wait_for_first_subscriber(core::Duration wait);
  bool is_first_pose_delivered();
  void publish_pending();
  void publish(const ipc::PoseRecord& record);
  bool report();
  void publish_reports();
  void fill_report();
  /// Summary of the last report.
  [[nodiscard]] std::string imu_summary() const;
  void sleep_until(core::Time time);
  void note_signals();

  pid_t parent_;
  ipc::Ring<ipc::PoseRecord> ring_;
  ipc::WakeEvent wake_event_;
  int signals_;
  std::unique_ptr<dds::OdometryPublisher> publisher_;
  std::unique_ptr<dds::ImuPoseLoop> imu_poses_;  ///< declared after the publisher, whose participant it uses
  const std::string host_id_ = dds::read_host_id();
  std::unique_ptr<PublishLatency> latency_;
  /// Refilled in place every time, which keeps the memory use constant.
  dds::LatencyReport report_;
  std::optional<ipc::PoseRecord> latest_;
  core::Time latest_taken_;
  core::Time next_report_;
  std::uint64_t published_ = 0;
  std::uint64_t failed_ = 0;
  bool stopping_ = false;
};

}  // namespace nilio::daemon
