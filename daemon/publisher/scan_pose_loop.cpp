#include "daemon/publisher/scan_pose_loop.hpp"

#include "nilio/core/clock.hpp"

#include <algorithm>
#include <memory>
#include <pthread.h>
#include <utility>

namespace nilio::dds {
namespace {

using core::Duration;
using core::Time;

// Also the longest sleep, in case a wake-up is missed.
constexpr Duration kHeartbeatPeriod{100'000'000};
constexpr Duration kSubscriberPoll{10'000'000};
// Together with the last report less than the 2 s that niliod waits for the end of this process.
constexpr Duration kMaxWaitWhenStopping{1'000'000'000};
// Time for reliable subscribers to acknowledge when poses arrive faster than the history is deep.
constexpr Duration kBacklogAcknowledgment{20'000'000};

}  // namespace

void PublishLatency::record(const ipc::PoseRecord& record, Time taken, Time written) noexcept {
  stages_.record(record);
  write_.record((written - taken).ns);
  const std::int64_t delivered = record.stage_time_ns(ipc::Stage::kDelivered);
  if (delivered != 0) pick_up_.record(taken.ns - delivered);
  const std::int64_t received = record.stage_time_ns(ipc::Stage::kReceived);
  if (received != 0)
    received_to_written_.record_corrected(written.ns - received, record.stamp_ns - record.scan_start_ns);
}

void PublishLatency::fill(std::span<StageLatency, kRows> rows) const {
  auto row = rows.begin();
  for (std::size_t i = 0; i < ipc::kLatencyStageCount; ++i) {
    const auto stage = static_cast<ipc::LatencyStage>(i);
    if (stage != ipc::LatencyStage::kMap)
      fill_stage_latency(ipc::kLatencyStageNames[i], stages_.histogram(stage), *row++);
  }
  fill_stage_latency("pick_up", pick_up_, *row++);
  fill_stage_latency("write", write_, *row++);
  fill_stage_latency("received_to_written", received_to_written_, *row);
}

ScanPoseLoop::ScanPoseLoop(ScanPoseInputs inputs, OdometryPublisher& publisher)
    : inputs_(std::move(inputs)), publisher_(publisher), latency_(std::make_unique<PublishLatency>()) {}

ScanPoseLoop::~ScanPoseLoop() { stop(); }

void ScanPoseLoop::start(std::function<void()> prepare, Duration wait_for_subscribers) {
  thread_ = std::thread([this, prepare = std::move(prepare), wait_for_subscribers] {
    pthread_setname_np(pthread_self(), "scan-poses");
    prepare();
    run(wait_for_subscribers);
  });
}

void ScanPoseLoop::stop() {
  if (!thread_.joinable()) return;
  stopping_.store(true);
  inputs_.wake.notify();
  thread_.join();
}

void ScanPoseLoop::run(Duration wait_for_subscribers) {
  wait_for_first_subscriber(wait_for_subscribers);
  started_.store(true, std::memory_order_release);
  while (true) {
    const bool last = stopping_.load();
    inputs_.state->beat();
    publish_pending();
    if (last) return;
    inputs_.wake.wait(kHeartbeatPeriod);
  }
}

// Waits until a subscriber has received the first pose or the wait expires; shortened by stop().
void ScanPoseLoop::wait_for_first_subscriber(Duration wait) {
  Time deadline = monotonic_now() + wait;
  bool shortened = false;
  while (!is_first_pose_delivered() && monotonic_now() < deadline) {
    inputs_.state->beat();
    if (stopping_.load() && !shortened) {
      deadline = std::min(deadline, monotonic_now() + kMaxWaitWhenStopping);
      shortened = true;
    }
    inputs_.wake.wait(kSubscriberPoll);
  }
}

// A matched subscriber may not have discovered this writer yet and receives nothing until then, and the
// history kept for it is short. Therefore the first pose is sent alone; the others follow once it is
// acknowledged.
bool ScanPoseLoop::is_first_pose_delivered() {
  if (publisher_.subscribers() == 0) return false;
  if (published_.load(std::memory_order_relaxed) == 0) {
    const auto records = inputs_.poses.begin_read();
    if (records.empty()) return stopping_.load();
    publish(records.front());
    inputs_.poses.consume(1);
  }
  return publisher_.wait_for_pose_acknowledgments(kBacklogAcknowledgment);
}

void ScanPoseLoop::publish_pending() {
  int in_a_row = 0;
  for (auto records = inputs_.poses.begin_read(); !records.empty(); records = inputs_.poses.begin_read()) {
    publish(records.front());
    inputs_.poses.consume(1);
    if (++in_a_row < OdometryPublisher::kHistoryDepth - 2) continue;
    // Pause in a backlog: otherwise the history overwrites poses that reliable subscribers have not received.
    publisher_.wait_for_pose_acknowledgments(kBacklogAcknowledgment);
    in_a_row = 0;
    inputs_.state->beat();
  }
}

void ScanPoseLoop::publish(const ipc::PoseRecord& record) {
  const Time taken = monotonic_now();
  const bool odometry_written = publisher_.publish_odometry(record);
  const Time written = monotonic_now();
  const bool transform_written = publisher_.publish_transform(record);
  const bool report_written =
      publisher_.publish_scan_report(make_scan_report(record, taken, written, host_id_));
  inputs_.state->record(record, taken, written, odometry_written);
  latency_->record(record, taken, written);
  pose_counts_.add(record, resets_.add(record));
  // The report's copy may be one pose old: this thread waits for nobody.
  if (const std::unique_lock lock(latest_mutex_, std::try_to_lock); lock)
    latest_ = Latest{record, taken, pose_counts_};
  published_.fetch_add(1, std::memory_order_relaxed);
  const std::uint64_t failed =
      (odometry_written ? 0U : 1U) + (transform_written ? 0U : 1U) + (report_written ? 0U : 1U);
  failed_.fetch_add(failed, std::memory_order_relaxed);
}

ScanPoseLoop::Counts ScanPoseLoop::counts() const {
  return {published_.load(std::memory_order_relaxed), failed_.load(std::memory_order_relaxed),
          inputs_.poses.dropped(), inputs_.poses.high_water()};
}

std::optional<ScanPoseLoop::Latest> ScanPoseLoop::latest() const {
  const std::lock_guard lock(latest_mutex_);
  std::optional<Latest> latest = latest_;
  if (!latest) return latest;
  latest->counts.late = inputs_.state->late_poses();
  latest->counts.failed_writes = failed_.load(std::memory_order_relaxed);
  latest->counts.ring_dropped = inputs_.poses.dropped();
  return latest;
}

}  // namespace nilio::dds
