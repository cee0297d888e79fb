#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "ipc/imu_pose_stream.hpp"
#include "ipc/overwriting_ring.hpp"
#include "ipc/publisher_state.hpp"
#include "ipc/records.hpp"
#include "ipc/restarted_process.hpp"
#include "ipc/ring.hpp"
#include "ipc/scan_cloud.hpp"
#include "ipc/shared_object.hpp"
#include "ipc/wake_event.hpp"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <sys/types.h>
#include <vector>

namespace nilio::ipc {

struct PublisherProcessConfig {
  std::filesystem::path executable;              ///< nilio-publisher
  std::uint32_t domain = 0;                      ///< DDS domain id
  std::vector<std::string> interface_whitelist;  ///< IPv4 addresses DDS may use; empty: all
  std::string odom_frame = "odom";
  std::string base_frame = "base_link";
  std::string topic_prefix;          ///< before the topic names, e.g. "vehicle_1" for rt/vehicle_1/odom
  bool transform = true;             ///< publish the transform of the pose
  std::size_t ring_capacity = 1024;  ///< poses kept while the publisher restarts
  /// If set, IMU-rate poses are published.
  std::optional<ImuPoseConfig> imu_poses;
  std::size_t scan_points = ScanCloud::kCapacity;  ///< maximum points of a published scan; 0: no scans
  double scan_rate_max_hz = 10.0;                  ///< maximum rate of published scans
  std::size_t path_poses = 10'000;          ///< maximum poses of the published path, the newest; 0: no path
  std::size_t sample_ring_capacity = 4096;  ///< IMU samples kept while the publisher restarts
  int nice = -5;  ///< nice value of the process; without the privilege it stays 0 with a warning
  /// SCHED_FIFO priority of its scan pose thread; 0: none of its threads is FIFO.
  int priority = 0;
  /// SCHED_FIFO priority of its IMU-rate pose thread; 0: only a lower nice value than its other threads.
  int imu_pose_priority = 0;
  bool lock_memory = false;  ///< lock all memory of the process
  core::Duration wait_for_subscribers{
      0};  ///< maximum wait of the first start for a subscriber before it reads the ring
  core::Duration start_interval = core::Duration::from_seconds(1.0);  ///< minimum time between two starts
  core::Duration hang_timeout =
      core::Duration::from_seconds(5.0);  ///< killed if it reads nothing for this time
};

/// Maximum of path_poses.
inline constexpr std::size_t kMaxPathPoses = 16'383;

struct PublisherEvent : ProcessEvent {
  std::size_t unpublished = 0;  ///< kStopped: poses left in the ring
};

/// Shared memory with `nilio-publisher`: rings with the producer here and the consumer there, and its state.
struct PublisherRings {
  Ring<PoseRecord> poses;
  WakeEvent wake;
  /// A second copy of the poses, and the samples, for the IMU-rate thread, so that neither thread waits for
  /// the other.
  Ring<PoseRecord> imu_poses;
  Ring<ImuRecord> samples;
  WakeEvent imu_wake;
  SharedObject<PublisherState> state;
  /// For the thread of large samples. The path ring holds the whole published path, also for a restarted
  /// process.
  OverwritingRing<ScanCloud> scans;
  OverwritingRing<PathPose> path;
  WakeEvent cloud_wake;

  static core::Result<PublisherRings> create(std::size_t poses, std::size_t samples);
};

/// Starts, supervises and restarts `nilio-publisher`, and owns the shared memory with it.
///
/// publish(), publish_scan() and publish_path_pose() belong to the odometry thread, publish_sample() to the
/// IMU receive thread, start(), poll() and stop() to one supervising thread (see RestartedProcess), the
/// getters to any thread.
class PublisherProcess {
 public:
  /// Creates the rings and wake events; starts nothing.
  static core::Result<std::unique_ptr<PublisherProcess>> create(PublisherProcessConfig config);
  PublisherProcess(const PublisherProcess&) = delete;
  PublisherProcess& operator=(const PublisherProcess&) = delete;

  /// Starts the process and returns its id. On failure poll() tries again, unless stop() is called.
  core::Result<pid_t> start() { return process_.start(); }
  /// Call about every 50 ms; does not block. At most one event per call.
  std::optional<PublisherEvent> poll();
  /// Lets the process publish the content of the ring (no more pushes allowed) and end; kills it after
  /// `timeout`. Blocks for that time. Empty if it was not running.
  std::optional<PublisherEvent> stop(core::Duration timeout = core::Duration::from_seconds(2.0));

  /// Pushes a pose. Wait-free apart from one write to an eventfd. False, and one more ring().dropped(), if
  /// the ring is full.
  bool publish(const PoseRecord& record) noexcept;
  /// Pushes an IMU sample; drops are counted in samples().dropped(). No effect without imu_poses in the
  /// configuration.
  bool publish_sample(const ImuRecord& record) noexcept;
  /// Whether somebody subscribes to scans.
  [[nodiscard]] bool wants_scans() const { return rings_.scans.wanted(); }
  /// Pushes a scan or a pose of the path, overwriting older ones; never waits. Both for the odometry thread.
  void publish_scan(const ScanCloud& scan) noexcept;
  void publish_path_pose(const PathPose& pose) noexcept { rings_.path.push(pose); }
  [[nodiscard]] const OverwritingRing<ScanCloud>& scans() const { return rings_.scans; }
  [[nodiscard]] const Ring<PoseRecord>& ring() const { return rings_.poses; }
  [[nodiscard]] Ring<PoseRecord>& ring() { return rings_.poses; }
  [[nodiscard]] const Ring<ImuRecord>& samples() const { return rings_.samples; }
  [[nodiscard]] WakeEvent& wake_event() { return rings_.wake; }
  /// Counters of the poses written to DDS, over all restarts of the publisher.
  [[nodiscard]] const PublisherState& state() const { return *rings_.state; }
  /// See RestartedProcess.
  void hasten() const { process_.hasten(); }
  [[nodiscard]] bool running() const { return process_.running(); }
  [[nodiscard]] pid_t pid() const { return process_.pid(); }
  [[nodiscard]] std::uint64_t restarts() const { return process_.restarts(); }

 private:
  using Clock = std::chrono::steady_clock;

  PublisherProcess(PublisherProcessConfig config, PublisherRings rings);
  core::Result<pid_t> spawn(core::Duration wait_for_subscribers);
  [[nodiscard]] std::vector<std::string> arguments(core::Duration wait_for_subscribers) const;
  // Last progress of a ring's consumer, to detect a hang.
  struct Progress {
    std::uint64_t consumed = 0;
    Clock::time_point at;
  };
  void reset_progress(Clock::time_point at);
  [[nodiscard]] bool is_hung();

  PublisherProcessConfig config_;
  PublisherRings rings_;
  RestartedProcess process_;
  Progress pose_progress_;
  Progress sample_progress_;
};

}  // namespace nilio::ipc
