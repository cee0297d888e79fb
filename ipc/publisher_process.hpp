#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "ipc/imu_pose_stream.hpp"
#include "ipc/imu_record.hpp"
#include "ipc/pose_record.hpp"
#include "ipc/ring.hpp"
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
  std::size_t ring_capacity = 1024;  ///< poses that survive while the publisher is away
  /// Set: poses at IMU rate are published, too.
  std::optional<ImuPoseConfig> imu_poses;
  std::size_t sample_ring_capacity = 4096;  ///< IMU samples that survive while the publisher is away
  int nice = -5;  ///< of the process; without the privilege it stays at 0 and says so
  /// SCHED_FIFO of its thread of poses at IMU rate; 0: that thread only comes before the process's others.
  int imu_pose_priority = 0;
  bool lock_memory = false;  ///< all of the process's
  core::Duration wait_for_subscribers{
      0};  ///< how long the first start waits for a subscriber before it reads the ring
  core::Duration initial_back_off =
      core::Duration::from_milliseconds(100.0);                     ///< doubles with every death ...
  core::Duration max_back_off = core::Duration::from_seconds(5.0);  ///< ... up to this ...
  core::Duration healthy_after =
      core::Duration::from_seconds(10.0);  ///< ... and starts again after a life this long
  core::Duration hang_timeout =
      core::Duration::from_seconds(5.0);  ///< killed when it reads nothing for so long
};

struct PublisherEvent {
  enum class Kind : std::uint8_t {
    kStarted,      ///< started again after a death
    kStartFailed,  ///< the start failed; tried again after `back_off`
    kDied,         ///< ended by itself or was killed; started again after `back_off`
    kHung,         ///< poses or samples wait but it reads none: killed, kDied follows
    kStopped       ///< ended as stop() wanted
  };
  Kind kind = Kind::kDied;
  pid_t pid = -1;
  int exit_status = -1;  ///< of a process that ended by itself, else -1
  int signal = 0;        ///< that killed it, else 0
  std::uint64_t restarts = 0;
  core::Duration back_off{0};
  std::size_t unpublished = 0;  ///< kStopped: poses left in the ring
  std::string message;          ///< all of it in one line, for the log
};

/// The rings in shared memory that feed `nilio-publisher`, each with one producer here and one consumer
/// there.
struct PublisherRings {
  Ring<PoseRecord> poses;
  WakeEvent wake;
  /// The same poses once more and the samples, for the thread that publishes at IMU rate, so that neither
  /// waits for the other.
  Ring<PoseRecord> imu_poses;
  Ring<ImuRecord> samples;
  WakeEvent imu_wake;

  static core::Result<PublisherRings> create(std::size_t poses, std::size_t samples);
};

/// Starts, watches and restarts `nilio-publisher`, and owns the rings in shared memory that feed it.
///
/// publish() belongs to one thread, the odometry thread, publish_sample() to one, the IMU's; all else to one
/// other thread, the supervisor, which must live as long as the process because the kernel ends the publisher
/// with the thread that started it.
class PublisherProcess {
 public:
  /// Makes the ring and the wake event; nothing runs yet.
  static core::Result<std::unique_ptr<PublisherProcess>> create(PublisherProcessConfig config);
  /// Kills the process if stop() was not called.
  ~PublisherProcess();
  PublisherProcess(const PublisherProcess&) = delete;
  PublisherProcess& operator=(const PublisherProcess&) = delete;

  /// The process id. Fails where the executable cannot be started: then poll() tries again, unless stop() is
  /// called.
  core::Result<pid_t> start();
  /// To be called about every 50 ms; does not block. At most one event per call.
  std::optional<PublisherEvent> poll();
  /// Lets the process publish what is in the ring (nothing may be pushed any more) and end; kills it after
  /// `timeout`. Blocks so long. Empty if it was not running.
  std::optional<PublisherEvent> stop(core::Duration timeout = core::Duration::from_seconds(2.0));

  /// Wait-free apart from one write to an eventfd. False, and one more ring().dropped(), when the ring is
  /// full.
  bool publish(const PoseRecord& record) noexcept;
  /// The same for a sample of the IMU, which counts in samples().dropped(). Without imu_poses in the
  /// configuration nothing is done.
  bool publish_sample(const ImuRecord& record) noexcept;
  [[nodiscard]] const Ring<PoseRecord>& ring() const { return rings_.poses; }
  [[nodiscard]] Ring<PoseRecord>& ring() { return rings_.poses; }
  [[nodiscard]] const Ring<ImuRecord>& samples() const { return rings_.samples; }
  [[nodiscard]] WakeEvent& wake_event() { return rings_.wake; }
  [[nodiscard]] bool running() const { return pid_ > 0; }
  [[nodiscard]] pid_t pid() const { return pid_; }
  [[nodiscard]] std::uint64_t restarts() const { return restarts_; }

 private:
  using Clock = std::chrono::steady_clock;

  PublisherProcess(PublisherProcessConfig config, PublisherRings rings);
  core::Result<pid_t> spawn(core::Duration wait_for_subscribers);
  [[nodiscard]] std::vector<std::string> arguments(core::Duration wait_for_subscribers) const;
  std::optional<PublisherEvent> poll_running();
  std::optional<PublisherEvent> poll_stopped();
  [[nodiscard]] PublisherEvent ended(PublisherEvent::Kind kind, int wait_status);
  void schedule_restart(PublisherEvent& event);
  // Whether something waits in a ring and nothing is taken.
  struct Progress {
    std::uint64_t consumed = 0;
    Clock::time_point at;
  };
  void reset_progress(Clock::time_point at);
  [[nodiscard]] bool is_hung();

  PublisherProcessConfig config_;
  PublisherRings rings_;
  pid_t pid_ = -1;
  bool wanted_ = false;
  std::uint64_t restarts_ = 0;
  core::Duration back_off_;
  Clock::time_point started_at_;
  Clock::time_point restart_at_;
  Progress pose_progress_;
  Progress sample_progress_;
};

}  // namespace nilio::ipc
