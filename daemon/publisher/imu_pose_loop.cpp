#include "daemon/publisher/imu_pose_loop.hpp"

#include "nilio/core/clock.hpp"

#include "ipc/dds/reports.hpp"

#include <pthread.h>
#include <utility>

namespace nilio::dds {
namespace {

// Upper limit of the sleep, in case a wake-up is missed.
constexpr core::Duration kLongestSleep{100'000'000};

}  // namespace

ImuPoseLoop::ImuPoseLoop(ImuPoseInputs inputs, const ipc::ImuPoseConfig& config,
                         std::unique_ptr<ImuPosePublisher> publisher)
    : inputs_(std::move(inputs)), stream_(config), publisher_(std::move(publisher)) {}

ImuPoseLoop::~ImuPoseLoop() { stop(); }

void ImuPoseLoop::start(std::function<void()> prepare) {
  thread_ = std::thread([this, prepare = std::move(prepare)] {
    pthread_setname_np(pthread_self(), "imu-poses");
    prepare();
    run();
  });
}

void ImuPoseLoop::stop() {
  if (!thread_.joinable()) return;
  stopping_.store(true);
  inputs_.wake.notify();
  thread_.join();
}

void ImuPoseLoop::run() {
  while (true) {
    const bool last = stopping_.load();
    drain();
    if (last) return;
    inputs_.wake.wait(kLongestSleep);
  }
}

void ImuPoseLoop::drain() {
  while (true) {
    // Samples first: a pose visible now but not before was delivered later.
    const auto samples = inputs_.samples.begin_read();
    const auto poses = inputs_.poses.begin_read();
    if (samples.empty() && poses.empty()) return;
    if (samples.empty() || (!poses.empty() && ipc::pose_comes_first(poses.front(), samples.front()))) {
      take_pose(poses.front());
      inputs_.poses.consume(1);
    } else {
      take_sample(samples.front());
      inputs_.samples.consume(1);
    }
  }
}

void ImuPoseLoop::take_pose(const ipc::PoseRecord& record) {
  const ipc::ImuPoseUpdate update = stream_.add(record);
  const ipc::ImuPoseCounts counts = stream_.counts();
  jumps_.store(counts.jumps, std::memory_order_relaxed);
  const ImuPoseStatus status{.stamp = update.stamp,
                             .scan_stamp = update.scan_stamp,
                             .scan_sequence = update.scan_sequence,
                             .correction_m = update.correction.distance_m,
                             .correction_rad = update.correction.angle_rad,
                             .jumped = update.correction.jumped,
                             .follows_gyro = record.imu_used,
                             .jumps = counts.jumps,
                             .published = counts.published,
                             .thinned = counts.thinned,
                             .withheld = counts.withheld};
  if (!publisher_->publish_status(status)) failed_.fetch_add(1, std::memory_order_relaxed);
}

void ImuPoseLoop::take_sample(const ipc::ImuRecord& record) {
  const std::int64_t taken = monotonic_ns();
  // Interval by the IMU's clock: samples received late arrive in a burst.
  const std::int64_t interval = last_stamp_ns_ != 0 ? record.sample.stamp.ns - last_stamp_ns_ : 0;
  last_stamp_ns_ = record.sample.stamp.ns;
  const auto pose = stream_.add(record);
  if (!pose) return;
  const bool accepted = publisher_->publish(*pose);
  const std::int64_t written = monotonic_ns();
  pick_up_.record(taken - record.received_ns);
  write_.record(written - taken);
  received_to_written_.record_corrected(written - record.received_ns, interval);
  (accepted ? published_ : failed_).fetch_add(1, std::memory_order_relaxed);
}

ImuPoseLoop::Counts ImuPoseLoop::counts() const {
  return {published_.load(std::memory_order_relaxed), failed_.load(std::memory_order_relaxed),
          jumps_.load(std::memory_order_relaxed), inputs_.samples.dropped(), inputs_.samples.high_water()};
}

void ImuPoseLoop::fill_latency(std::span<StageLatency, kLatencyRows> rows) const {
  fill_stage_latency("imu_pick_up", pick_up_, rows[0]);
  fill_stage_latency("imu_write", write_, rows[1]);
  fill_stage_latency("imu_received_to_written", received_to_written_, rows[2]);
}

}  // namespace nilio::dds
