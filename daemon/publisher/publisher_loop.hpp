#pragma once

#include "nilio/core/time.hpp"

#include "daemon/publisher/cloud_loop.hpp"
#include "daemon/publisher/imu_pose_loop.hpp"
#include "daemon/publisher/scan_pose_loop.hpp"
#include "ipc/dds/odometry_publisher.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <sys/types.h>

namespace nilio::daemon {

/// Main loop of nilio-publisher: reports once per second, log, signals, network interfaces. The poses have
/// threads of their own.
class PublisherLoop {
 public:
  /// Exit status that asks niliod to restart the process.
  static constexpr int kExitStartAgain = 75;  // EX_TEMPFAIL of sysexits.h

  /// `signals`: signalfd of the stop signals. `parent`: end with this process; 0 = none. The loops are
  /// running; `imu_poses` and `clouds` may be null.
  PublisherLoop(pid_t parent, int signals, std::unique_ptr<dds::OdometryPublisher> publisher,
                std::unique_ptr<dds::ScanPoseLoop> scan_poses, std::unique_ptr<dds::ImuPoseLoop> imu_poses,
                std::unique_ptr<dds::CloudLoop> clouds);

  /// Runs until a stop signal has arrived and the rings are empty. Returns the exit status.
  int run();

 private:
  /// False if a new process is needed.
  bool report();
  void publish_reports();
  void fill_report();
  void log_events();
  /// Summary of the last report.
  [[nodiscard]] std::string imu_summary() const;
  [[nodiscard]] std::string cloud_summary() const;
  void sleep_until(core::Time time);

  pid_t parent_;
  int signals_;
  // The publisher's participant outlives the loops that use it.
  std::unique_ptr<dds::OdometryPublisher> publisher_;
  std::unique_ptr<dds::ScanPoseLoop> scan_poses_;
  std::unique_ptr<dds::ImuPoseLoop> imu_poses_;
  std::unique_ptr<dds::CloudLoop> clouds_;
  /// Refilled in place every time, which keeps the memory use constant.
  dds::LatencyReport report_;
  /// Counts at the last report; empty before the first one, which must not report what an earlier process
  /// did.
  std::optional<dds::PoseCounts> counted_;
  std::uint64_t imu_jumps_logged_ = 0;
  bool start_logged_ = false;
  bool failure_logged_ = false;
  bool stopping_ = false;
};

}  // namespace nilio::daemon
