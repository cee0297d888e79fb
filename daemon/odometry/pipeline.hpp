#pragma once

#include "nilio/core/result.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/input.hpp"
#include "daemon/input/lidar_channel.hpp"
#include "daemon/input/merged_scan_feed.hpp"
#include "daemon/input/receive.hpp"
#include "daemon/odometry/odometry_loop.hpp"
#include "daemon/output/event_log.hpp"
#include "daemon/realtime/realtime_thread.hpp"
#include "ipc/mapper_process.hpp"
#include "ipc/publisher_process.hpp"

#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

struct PipelineOptions {
  RunRules rules;
  /// Decisions of an earlier run to repeat.
  std::vector<ScanDecision> decisions{};
  ipc::MapperProcess* mapper = nullptr;  ///< gets keyframes; outlives the pipeline
  bool collect_clouds = false;           ///< fill clouds()
  bool record = false;                   ///< fill LidarInput::recorded and recorded_frames()
  /// Clock of the odometry's stage stamps.
  core::Odometry::ClockFunction clock = monotonic_ns;
  ScanObserver observer{};
  ThreadHook thread_hook = nullptr;
};

/// Source, ring, receive state and channel of one LiDAR.
struct LidarInput {
  LidarInput(const std::string& section, const LidarConfig& config,
             const drivers::ScanAssemblerConfig& assembler, drivers::PacketSource& packet_source,
             const std::optional<drivers::VelodyneSensor>& sensor, EventLog& log);

  drivers::PacketSource& source;
  ipc::Ring<drivers::Packet> ring;
  /// Copy of the packets that entered `ring`, if the run is recorded.
  std::optional<ipc::Ring<drivers::Packet>> recorded;
  ReceiveState state;
  LidarChannel channel;
};

/// Receive threads, rings and odometry thread of one run. The owner (supervisor) drains poses() and clouds()
/// and decides when to stop. Call start, stop and join from one thread.
class Pipeline {
 public:
  /// `publisher` may be null and must outlive the pipeline.
  static core::Result<std::unique_ptr<Pipeline>> create(const Config& config, Input input,
                                                        const PipelineOptions& options,
                                                        ipc::PublisherProcess* publisher);
  ~Pipeline();
  Pipeline(const Pipeline&) = delete;
  Pipeline& operator=(const Pipeline&) = delete;

  /// Starts the threads and returns the outcome of each request to the kernel. When it returns, the workers
  /// run and all memory is touched. In strict mode a refused request is an error and no thread runs.
  core::Result<std::vector<PlanOutcome>> start();
  void request_stop();
  void join();
  /// Real-time threads from start() to join().
  [[nodiscard]] const std::vector<RealtimeThread>& threads() const { return threads_; }
  /// The odometry thread has ended: all input is processed, or stop was requested.
  [[nodiscard]] bool finished() const { return finished_.load(std::memory_order_acquire); }

  [[nodiscard]] ipc::Ring<ipc::PoseRecord>& poses() { return poses_; }
  [[nodiscard]] ipc::Ring<CloudRecord>& clouds() { return clouds_; }
  [[nodiscard]] const ipc::Ring<CloudRecord>& clouds() const { return clouds_; }
  /// Log lines of the threads, to be drained by the owner.
  [[nodiscard]] EventLog& event_log() { return event_log_; }
  [[nodiscard]] const EventLog& event_log() const { return event_log_; }
  [[nodiscard]] ipc::Ring<core::ImuHealth>& imu_health() { return imu_health_; }
  /// Under live rules: one decision per complete scan.
  [[nodiscard]] ipc::Ring<ScanDecision>& decisions() { return decisions_; }
  [[nodiscard]] const ipc::Ring<ScanDecision>& decisions() const { return decisions_; }
  /// Copy of the frames that entered the IMU decoder; null unless the run is recorded with an IMU on CAN.
  [[nodiscard]] ipc::Ring<drivers::CanFrame>* recorded_frames() {
    return recorded_frames_ ? &*recorded_frames_ : nullptr;
  }
  [[nodiscard]] const ipc::Ring<drivers::CanFrame>* recorded_frames() const {
    return recorded_frames_ ? &*recorded_frames_ : nullptr;
  }
  /// Interface named in the recorded frames.
  [[nodiscard]] std::string can_interface() const {
    return config_.imu.interface_name.empty() ? "can0" : config_.imu.interface_name;
  }
  [[nodiscard]] const core::BudgetConfig& budget() const { return budget_; }
  /// Notified after every pose and at the end.
  [[nodiscard]] ipc::WakeEvent& output_event() { return output_event_; }
  [[nodiscard]] const OdometryCounters& counters() const { return counters_; }
  [[nodiscard]] const Input& input() const { return input_; }
  /// Of each beam of the LiDAR at the end, none before it. Call after join().
  [[nodiscard]] const std::vector<core::BeamCorrection>& beam_corrections() const {
    return beam_corrections_;
  }
  /// First LiDAR, then the additional ones; empty for data sets of scans. Before join(), only
  /// members of a channel for any thread may be called.
  [[nodiscard]] const std::vector<std::unique_ptr<LidarInput>>& lidars() const { return lidars_; }
  [[nodiscard]] const ReceiveState& imu_state() const { return imu_state_; }
  /// Packets of all LiDARs dropped because of full rings.
  [[nodiscard]] std::uint64_t packets_dropped() const;
  /// Packets of senders that are not a sensor of this run.
  [[nodiscard]] std::uint64_t foreign_packets() const;
  [[nodiscard]] std::uint64_t samples_dropped() const { return imu_ring_.dropped(); }
  /// After join(): counters of lidars()[index], index >= 1.
  [[nodiscard]] const MergeCounters& merge_counters(std::size_t index) const {
    return merged_feed_->counters(index - 1);
  }
  /// After join(): statistics of the first LiDAR.
  [[nodiscard]] drivers::ScanAssemblerStats scan_stats() const { return feed_->stats(); }
  [[nodiscard]] drivers::ImuDecoderStats imu_stats() const;

 private:
  Pipeline(const Config& config, Input input, const PipelineOptions& options,
           ipc::PublisherProcess* publisher, ThreadPlan plan, ipc::WakeEvent data_event,
           ipc::WakeEvent output_event);
  void make_feed();
  void make_merged_feed();
  [[nodiscard]] OdometryLoopConfig loop_config() const;
  void start_thread(ThreadRole role, RealtimeWork work, std::vector<PlanOutcome>& outcomes);
  [[nodiscard]] RealtimeWork odometry_work();
  [[nodiscard]] std::unique_ptr<OdometryLoop> make_loop();
  std::vector<PlanOutcome> warm_up(OdometryLoop& loop);

  Config config_;
  Input input_;
  PipelineOptions options_;
  core::BudgetConfig budget_;
  ipc::PublisherProcess* publisher_;
  ThreadPlan plan_;
  ReceivePolicy policy_;

  EventLog event_log_;
  std::vector<std::unique_ptr<LidarInput>> lidars_;
  ipc::Ring<core::ImuSample> imu_ring_;
  std::optional<ipc::Ring<drivers::CanFrame>> recorded_frames_;
  ipc::Ring<ipc::PoseRecord> poses_;
  ipc::Ring<CloudRecord> clouds_;
  ipc::Ring<core::ImuHealth> imu_health_;
  std::vector<core::BeamCorrection> beam_corrections_;
  ipc::Ring<ScanDecision> decisions_;
  ipc::WakeEvent data_event_;
  ipc::WakeEvent output_event_;

  ReceiveState imu_state_;
  OdometryCounters counters_;
  /// See ReceivePolicy.
  std::atomic<std::int64_t> gather_until_ns_{0};
  std::unique_ptr<PacketScanFeed> packet_feed_;
  std::unique_ptr<MergedScanFeed> merged_feed_;
  ScanFeed* feed_ = nullptr;
  std::unique_ptr<DeadlineGuard> guard_;
  std::atomic<bool> stop_{false};
  std::atomic<bool> finished_{false};
  std::vector<RealtimeThread> threads_;
};

}  // namespace nilio::daemon
