#pragma once

#include "nilio/core/time.hpp"

#include "ipc/dds/imu_pose_publisher.hpp"
#include "ipc/histogram.hpp"
#include "ipc/imu_pose_stream.hpp"
#include "ipc/records.hpp"
#include "ipc/ring.hpp"
#include "ipc/wake_event.hpp"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <thread>

namespace nilio::dds {

/// Shared-memory inputs of the IMU-rate pose thread in the publisher process.
struct ImuPoseInputs {
  ipc::Ring<ipc::PoseRecord> poses;
  ipc::Ring<ipc::ImuRecord> samples;
  ipc::WakeEvent wake;
};

/// Thread that publishes a pose for every IMU sample. It shares nothing with the publisher of scan poses, so
/// a slow registration or a slow subscriber of those cannot delay it. A sample is consumed after its pose is
/// written, so that a restarted process continues with the next sample.
class ImuPoseLoop {
 public:
  struct Counts {
    std::uint64_t published = 0;
    std::uint64_t failed_writes = 0;
    std::uint64_t jumps = 0;
    std::uint64_t ring_dropped = 0;
    std::uint64_t ring_high_water = 0;
  };

  ImuPoseLoop(ImuPoseInputs inputs, const ipc::ImuPoseConfig& config,
              std::unique_ptr<ImuPosePublisher> publisher);
  /// Stops the thread.
  ~ImuPoseLoop();
  ImuPoseLoop(const ImuPoseLoop&) = delete;
  ImuPoseLoop& operator=(const ImuPoseLoop&) = delete;

  /// Starts the thread. It calls `prepare` first, which requests its priority.
  void start(std::function<void()> prepare);
  /// Publishes the remaining content of the rings and ends the thread.
  void stop();

  // Any thread.
  [[nodiscard]] Counts counts() const;
  static constexpr std::size_t kLatencyRows = 3;
  /// Rows of the latency report: last CAN frame to pick-up, pick-up to the return of write(), and their sum.
  void fill_latency(std::span<StageLatency, kLatencyRows> rows) const;

 private:
  void run();
  void drain();
  void take_pose(const ipc::PoseRecord& record);
  void take_sample(const ipc::ImuRecord& record);

  ImuPoseInputs inputs_;
  ipc::ImuPoseStream stream_;
  std::unique_ptr<ImuPosePublisher> publisher_;
  ipc::Histogram pick_up_;
  ipc::Histogram write_;
  ipc::Histogram received_to_written_;
  std::int64_t last_stamp_ns_ = 0;
  std::atomic<std::uint64_t> published_{0};
  std::atomic<std::uint64_t> failed_{0};
  std::atomic<std::uint64_t> jumps_{0};
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace nilio::dds
