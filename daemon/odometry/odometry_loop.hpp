#pragma once

#include "nilio/core/odometry.hpp"
#include "nilio/core/odometry_runtime.hpp"

#include "daemon/input/receive.hpp"
#include "daemon/input/scan_feed.hpp"
#include "daemon/odometry/cloud_feed.hpp"
#include "daemon/odometry/deadline_guard.hpp"
#include "daemon/odometry/decision_log.hpp"
#include "daemon/odometry/sample_period.hpp"
#include "daemon/realtime/run_rules.hpp"
#include "daemon/realtime/thread_hook.hpp"
#include "ipc/mapper_process.hpp"
#include "ipc/publisher_process.hpp"
#include "ipc/records.hpp"
#include "ipc/ring.hpp"
#include "ipc/wake_event.hpp"

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>

namespace nilio::daemon {

/// Subset of a registered scan in the odom frame for run.mcap; passed between threads by value.
struct CloudRecord {
  static constexpr std::size_t kCapacity = 1024;
  std::int64_t stamp_ns = 0;  ///< of the pose
  std::uint32_t count = 0;
  std::array<std::array<float, 3>, kCapacity> points{};
};

/// Counters of the odometry thread, readable by the supervisor.
struct OdometryCounters {
  std::atomic<std::uint64_t> scans{0};  ///< complete scans, including superseded ones
  std::atomic<std::uint64_t> poses{0};
  std::atomic<std::uint64_t> superseded{0};  ///< live: a newer complete scan was waiting
  std::atomic<std::uint64_t> imu_samples{0};
  std::atomic<std::uint64_t> imu_refused{0};   ///< time went back or values not finite
  std::atomic<std::uint64_t> imu_timeouts{0};  ///< live: registered without waiting further for the IMU
  std::atomic<std::uint64_t> scans_with_imu{0};
  /// Replay with decisions: scans whose number differs from the decision log.
  std::atomic<std::uint64_t> decisions_missed{0};
};

/// Called by the odometry thread after each registered scan; for measurements.
using ScanObserver =
    std::function<void(const core::Scan&, const core::OdometryResult&, const core::Odometry&)>;

/// Outputs of the odometry thread. Null = unused.
struct OdometryOutputs {
  ipc::Ring<ipc::PoseRecord>* poses = nullptr;       ///< to the supervisor
  ipc::Ring<CloudRecord>* clouds = nullptr;          ///< to the supervisor
  ipc::Ring<core::ImuHealth>* imu_health = nullptr;  ///< to the supervisor, on changes
  ipc::WakeEvent* event = nullptr;                   ///< notified after every pose
  ipc::PublisherProcess* publisher = nullptr;
  ipc::MapperProcess* mapper = nullptr;
  ipc::Ring<ScanDecision>* decisions = nullptr;  ///< to the supervisor
  /// Publishes late poses instead of this thread, with the same publisher.
  DeadlineGuard* guard = nullptr;
  ScanObserver observer;
};

struct OdometryLoopConfig {
  /// Without live rules every scan is processed, full rings block, and IMU samples are waited for until the
  /// log ends.
  RunRules rules;
  /// Live: maximum time a complete scan waits for its IMU samples, from its last packet.
  core::Duration imu_wait = core::Duration::from_milliseconds(20.0);
  /// The samples are in the packets of the feed.
  bool has_lidar_imu = false;
  /// Scans do not wait for an IMU before its first sample: it is not known yet whether there is one.
  bool may_lack_imu = false;
  /// Decisions of an earlier run to repeat instead of decisions by the clock; the run ends with them.
  const std::vector<ScanDecision>* decisions = nullptr;
  ThreadHook hook = nullptr;
};

/// Work of the odometry thread: takes a complete scan, waits for the IMU samples that cover it, registers it
/// and publishes the pose.
class OdometryLoop {
 public:
  /// All references and pointers must outlive the loop. `imu_state` is null without an IMU.
  OdometryLoop(core::Odometry odometry, ScanFeed& feed, ipc::Ring<core::ImuSample>* imu_ring,
               ipc::WakeEvent& data_event, ReceiveState* imu_state, const OdometryOutputs& outputs,
               const OdometryLoopConfig& config);

  /// See core::OdometryRuntime::warm_up().
  int warm_up(const std::function<void()>& on_thread) { return runtime_.warm_up(on_thread); }
  /// One round: at most one scan. False at the end of the feed and after `stop`.
  bool run(const std::atomic<bool>& stop, OdometryCounters& counters);
  /// After the last round.
  void finish() { push_imu_health(true); }
  /// Of each beam of the LiDAR; see core::Odometry::beam_correction().
  [[nodiscard]] std::vector<core::BeamCorrection> beam_corrections() const;

 private:
  void report_warm(const OdometryCounters& counters);
  void supersede(const core::Scan& scan, OdometryCounters& counters);
  void process(const core::Scan& scan, const std::atomic<bool>& stop, OdometryCounters& counters);
  bool repeat(const core::Scan& scan, const std::atomic<bool>& stop, OdometryCounters& counters);
  void wait_for_imu(const core::Scan& scan, const std::atomic<bool>& stop, OdometryCounters& counters);
  [[nodiscard]] bool imu_can_arrive(const core::Scan& scan, std::int64_t deadline) const;
  bool drain_imu(core::Time end, OdometryCounters& counters);
  bool take_imu_sample(OdometryCounters& counters);
  void take_imu_samples(std::uint64_t count, const std::atomic<bool>& stop, OdometryCounters& counters);
  void wait_for_samples(core::Duration timeout);
  void register_and_publish(const core::Scan& scan, const ScanDecision* decision,
                            const std::atomic<bool>& stop, OdometryCounters& counters);
  [[nodiscard]] ipc::PoseRecord complete_record(const core::OdometryResult& result, const core::Scan& scan,
                                                const OdometryCounters& counters);
  void arm_guard(const core::OdometryResult& prediction, const core::Scan& scan,
                 const OdometryCounters& counters);
  [[nodiscard]] bool deliver(ipc::PoseRecord& record);
  void push_pose(const ipc::PoseRecord& record, const std::atomic<bool>& stop);
  void push_decision(const core::Scan& scan, bool superseded, bool guarded);
  void wait_for_mapper(const core::OdometryResult& result, const std::atomic<bool>& stop);
  void push_cloud(const core::OdometryResult& result, const std::atomic<bool>& stop);
  /// Replay: waits for a free slot.
  template <class T>
  void wait_for_room(const ipc::Ring<T>& ring, const std::atomic<bool>& stop) const;
  void push_imu_health(bool always);

  core::Odometry odometry_;
  core::OdometryRuntime runtime_{odometry_};
  ScanFeed& feed_;
  ipc::Ring<core::ImuSample>* imu_ring_;
  ipc::WakeEvent& data_event_;
  ReceiveState* imu_state_;
  OdometryOutputs outputs_;
  OdometryLoopConfig config_;
  CloudFeed cloud_feed_;
  core::Scan scan_;
  bool skipped_time_jump_ = false;  ///< of superseded scans, for the next one
  core::Duration skipped_clock_step_;
  core::ImuHealth pushed_health_;
  std::uint64_t imu_samples_taken_ = 0;  ///< samples passed to the odometry
  SamplePeriodEstimator sample_period_;
  std::size_t next_decision_ = 0;
  bool warm_reported_ = false;
  bool mapper_is_stuck_ = false;
};

/// Stamps the delivery time of a record.
void stamp_delivery(ipc::PoseRecord& record);

/// Converts an odometry result into a record; stage stamps come from the scan and the result.
ipc::PoseRecord make_pose_record(const core::OdometryResult& result, const core::Scan& scan);

}  // namespace nilio::daemon
