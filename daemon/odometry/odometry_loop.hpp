#pragma once

#include "nilio/core/odometry.hpp"

#include "daemon/input/receive.hpp"
#include "daemon/input/scan_feed.hpp"
#include "daemon/odometry/deadline_guard.hpp"
#include "daemon/odometry/decision_log.hpp"
#include "daemon/odometry/sample_period.hpp"
#include "daemon/realtime/thread_plan.hpp"
#include "ipc/pose_record.hpp"
#include "ipc/publisher_process.hpp"
#include "ipc/ring.hpp"
#include "ipc/wake_event.hpp"

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>

namespace nilio::daemon {

/// A sample of a registered scan in the odom frame, for the map picture; crosses threads by value.
struct CloudRecord {
  static constexpr std::size_t kCapacity = 1024;
  std::uint32_t count = 0;
  std::array<std::array<float, 3>, kCapacity> points{};
};

/// Counters of the odometry thread, readable from the supervisor.
struct OdometryCounters {
  std::atomic<std::uint64_t> scans{0};  ///< complete scans, superseded ones included
  std::atomic<std::uint64_t> poses{0};
  std::atomic<std::uint64_t> superseded{0};  ///< live: a newer complete scan was waiting
  std::atomic<std::uint64_t> imu_samples{0};
  std::atomic<std::uint64_t> imu_refused{0};   ///< time went back or not finite
  std::atomic<std::uint64_t> imu_timeouts{0};  ///< live: registered without waiting for the IMU any longer
  std::atomic<std::uint64_t> scans_with_imu{0};
  /// Repeating decisions: scans of the recording that the log has, but not in this place.
  std::atomic<std::uint64_t> decisions_missed{0};
  std::atomic<std::uint64_t> heartbeat{0};
};

/// Told by the odometry thread of every scan that it has registered; for measurements.
using ScanObserver =
    std::function<void(const core::Scan&, const core::OdometryResult&, const core::Odometry&)>;

/// Where the odometry thread's results go. Null = not wanted.
struct OdometryOutputs {
  ipc::Ring<ipc::PoseRecord>* poses = nullptr;       ///< to the supervisor
  ipc::Ring<CloudRecord>* clouds = nullptr;          ///< to the supervisor
  ipc::Ring<core::ImuHealth>* imu_health = nullptr;  ///< to the supervisor, when something changes
  ipc::WakeEvent* event = nullptr;                   ///< woken after every pose
  ipc::PublisherProcess* publisher = nullptr;
  ipc::Ring<ScanDecision>* decisions = nullptr;  ///< to the supervisor
  /// Publishes in this thread's place what is late. It has the same publisher.
  DeadlineGuard* guard = nullptr;
  ScanObserver observer;
};

struct OdometryLoopConfig {
  /// A recording: every scan counts, rings wait, IMU samples are waited for until the log says there are
  /// none.
  bool lossless = false;
  /// Live: how long after its last packet a complete scan waits for its IMU samples.
  core::Duration imu_wait = core::Duration::from_milliseconds(20.0);
  /// Of an earlier run, to be repeated: they decide in place of clocks, and the run ends with them.
  const std::vector<ScanDecision>* decisions = nullptr;
  ThreadHook hook = nullptr;
};

/// The odometry thread's work: take a complete scan, wait for the IMU samples that cover it, register, hand
/// the pose over.
class OdometryLoop {
 public:
  /// All references and pointers have to outlive the loop. `imu_state` is null without an IMU.
  OdometryLoop(core::Odometry odometry, ScanFeed& feed, ipc::Ring<core::ImuSample>* imu_ring,
               ipc::WakeEvent& data_event, const ReceiveState* imu_state, const OdometryOutputs& outputs,
               const OdometryLoopConfig& config);

  /// core::Odometry::warm_up().
  int warm_up(const std::function<void()>& on_thread) { return odometry_.warm_up(on_thread); }
  /// Until the feed is at its end or `stop`.
  void run(const std::atomic<bool>& stop, OdometryCounters& counters);

 private:
  void tell_when_warm(const OdometryCounters& counters);
  void work_off(const core::Scan& scan, const std::atomic<bool>& stop, OdometryCounters& counters);
  bool repeat(const core::Scan& scan, const std::atomic<bool>& stop, OdometryCounters& counters);
  void wait_for_imu(const core::Scan& scan, const std::atomic<bool>& stop, OdometryCounters& counters);
  [[nodiscard]] bool imu_may_come(const core::Scan& scan, std::int64_t deadline) const;
  bool drain_imu(core::Time end, OdometryCounters& counters);
  bool take_imu_sample(OdometryCounters& counters);
  void take_imu_samples(std::uint64_t count, const std::atomic<bool>& stop, OdometryCounters& counters);
  void register_and_hand_over(const core::Scan& scan, const ScanDecision* decision,
                              const std::atomic<bool>& stop, OdometryCounters& counters);
  [[nodiscard]] ipc::PoseRecord complete_record(const core::OdometryResult& result, const core::Scan& scan,
                                                const OdometryCounters& counters);
  void arm_guard(const core::OdometryResult& prediction, const core::Scan& scan,
                 const OdometryCounters& counters);
  [[nodiscard]] bool hand_over(ipc::PoseRecord& record);
  void push_pose(const ipc::PoseRecord& record, const std::atomic<bool>& stop);
  void push_decision(const core::Scan& scan, bool superseded, bool guarded);
  void push_cloud(const core::OdometryResult& result);
  void push_imu_health(bool always);

  core::Odometry odometry_;
  ScanFeed& feed_;
  ipc::Ring<core::ImuSample>* imu_ring_;
  ipc::WakeEvent& data_event_;
  const ReceiveState* imu_state_;
  OdometryOutputs outputs_;
  OdometryLoopConfig config_;
  core::ImuHealth pushed_health_;
  std::uint64_t imu_given_ = 0;  ///< samples that the odometry was given
  SampleRhythm rhythm_;
  std::size_t next_decision_ = 0;
  bool warm_told_ = false;
};

/// Notes in a record that it is handed over now.
void stamp_hand_over(ipc::PoseRecord& record);

/// The record of a result; stage stamps come from the scan and the result.
ipc::PoseRecord make_pose_record(const core::OdometryResult& result, const core::Scan& scan);

}  // namespace nilio::daemon
