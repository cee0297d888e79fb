#pragma once

#include "nilio/core/time.hpp"

#include "daemon/publisher/imu_pose_loop.hpp"
#include "ipc/dds/odometry_publisher.hpp"
#include "ipc/dds/reports.hpp"
#include "ipc/histogram.hpp"
#include "ipc/pose_record.hpp"
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

/// Where the time goes, up to the return of write().
class PublishLatency {
 public:
  void record(const ipc::PoseRecord& record, core::Time taken, core::Time written) noexcept;
  /// Feeding the map is left out: it comes after the pose has come here.
  static constexpr std::size_t kRows = ipc::kLatencyStageCount - 1 + 3;
  void fill(std::span<dds::StageLatency, kRows> rows) const;

 private:
  ipc::LatencyHistograms stages_;
  ipc::Histogram pick_up_;
  ipc::Histogram write_;
  ipc::Histogram received_to_written_;
};

/// The loop between the ring and DDS: the poses of the scans, their transform and the reports.
class PublisherLoop {
 public:
  /// Exit status by which niliod is asked to start the process anew.
  static constexpr int kExitStartAgain = 75;  // EX_TEMPFAIL of sysexits.h

  /// `signals`: a signalfd of those that end the process. `imu_poses` may be null. `parent`: process whose
  /// end ends this one, 0 for none.
  PublisherLoop(pid_t parent, ipc::Ring<ipc::PoseRecord> ring, ipc::WakeEvent wake_event, int signals,
                std::unique_ptr<dds::OdometryPublisher> publisher,
                std::unique_ptr<dds::ImuPoseLoop> imu_poses);

  /// Until a signal and an empty ring. Returns the exit status.
  int run(core::Duration wait_for_subscribers);

 private:
  void wait_for_first_subscriber(core::Duration wait);
  bool is_first_pose_delivered();
  void publish_pending();
  void publish(const ipc::PoseRecord& record);
  bool report();
  void publish_reports();
  void fill_report();
  /// As the last report has it.
  [[nodiscard]] std::string imu_summary() const;
  void sleep_until(core::Time time);
  void note_signals();

  pid_t parent_;
  ipc::Ring<ipc::PoseRecord> ring_;
  ipc::WakeEvent wake_event_;
  int signals_;
  std::unique_ptr<dds::OdometryPublisher> publisher_;
  std::unique_ptr<dds::ImuPoseLoop> imu_poses_;  ///< after the publisher, whose participant it uses
  const std::string host_id_ = dds::read_host_id();
  std::unique_ptr<PublishLatency> latency_;
  /// Filled anew every time in the memory that it has: that of the process stays level.
  dds::LatencyReport report_;
  std::optional<ipc::PoseRecord> latest_;
  core::Time latest_taken_;
  core::Time next_report_;
  std::uint64_t published_ = 0;
  std::uint64_t failed_ = 0;
  bool stopping_ = false;
};

}  // namespace nilio::daemon
