#include "daemon/publisher/publisher_loop.hpp"

#include "nilio/core/clock.hpp"

#include "ipc/dds/reports.hpp"

#include <algorithm>
#include <array>
#include <csignal>
#include <ctime>
#include <poll.h>
#include <sys/signalfd.h>
#include <unistd.h>
#include <utility>

#include <spdlog/spdlog.h>

namespace nilio::daemon {

namespace {

using core::Duration;
using core::Time;

constexpr Duration kReportPeriod{1'000'000'000};
// Together less than the 2 s that niliod waits for the end of this process.
constexpr Duration kMaxWaitWhenStopping{1'000'000'000};
constexpr Duration kLastAcknowledgments{500'000'000};
// Time for reliable subscribers to acknowledge when poses arrive faster than the history is deep.
constexpr Duration kBacklogAcknowledgment{20'000'000};

Time monotonic_now() { return {monotonic_ns()}; }

Time stage_time(const ipc::PoseRecord& record, ipc::Stage stage) {
  return {record.stage_ns[static_cast<std::size_t>(stage)]};
}

}  // namespace

void PublishLatency::record(const ipc::PoseRecord& record, Time taken, Time written) noexcept {
  stages_.record(record);
  write_.record((written - taken).ns);
  const Time delivered = stage_time(record, ipc::Stage::kDelivered);
  if (delivered.ns != 0) pick_up_.record((taken - delivered).ns);
  const Time received = stage_time(record, ipc::Stage::kReceived);
  if (received.ns != 0)
    received_to_written_.record_corrected((written - received).ns, record.stamp_ns - record.scan_start_ns);
}

void PublishLatency::fill(std::span<dds::StageLatency, kRows> rows) const {
  auto row = rows.begin();
  for (std::size_t i = 0; i < ipc::kLatencyStageCount; ++i) {
    const auto stage = static_cast<ipc::LatencyStage>(i);
    if (stage != ipc::LatencyStage::kMap)
      dds::fill_stage_latency(ipc::kLatencyStageNames[i], stages_.histogram(stage), *row++);
  }
  dds::fill_stage_latency("pick_up", pick_up_, *row++);
  dds::fill_stage_latency("write", write_, *row++);
  dds::fill_stage_latency("received_to_written", received_to_written_, *row);
}

PublisherLoop::PublisherLoop(pid_t parent, ipc::Ring<ipc::PoseRecord> ring, ipc::WakeEvent wake_event,
                             int signals, std::unique_ptr<dds::OdometryPublisher> publisher,
                             std::unique_ptr<dds::ImuPoseLoop> imu_poses)
    : parent_(parent),
      ring_(std::move(ring)),
      wake_event_(std::move(wake_event)),
      signals_(signals),
      publisher_(std::move(publisher)),
      imu_poses_(std::move(imu_poses)),
      latency_(std::make_unique<PublishLatency>()) {
  report_.stages.resize(PublishLatency::kRows + (imu_poses_ ? dds::ImuPoseLoop::kLatencyRows : 0));
}

int PublisherLoop::run(Duration wait_for_subscribers) {
  wait_for_first_subscriber(wait_for_subscribers);
  next_report_ = monotonic_now();
  while (true) {
    publish_pending();
    if (stopping_ && ring_.size() == 0) break;
    if (monotonic_now() >= next_report_ && !report()) return kExitStartAgain;
    if (!stopping_ && ring_.size() == 0) sleep_until(next_report_);
  }
  if (imu_poses_) imu_poses_->stop();
  publish_reports();
  const bool acknowledged = publisher_->wait_for_acknowledgments(kLastAcknowledgments);
  spdlog::info("stopped: {} poses published, {} writes failed{}{}", published_, failed_,
               acknowledged ? "" : ", not all acknowledged by every subscriber", imu_summary());
  return 0;
}

std::string PublisherLoop::imu_summary() const {
  if (!imu_poses_) return "";
  const dds::ImuPoseLoop::Counts counts = imu_poses_->counts();
  const dds::StageLatency& latency = report_.stages.back();
  return fmt::format(
      "; IMU rate: {} poses, {} writes failed, {} samples dropped, {} jumps; CAN to DDS p50 {:.0f}, p99 "
      "{:.0f}, max {:.0f} us",
      counts.published, counts.failed_writes, counts.ring_dropped, counts.jumps, latency.p50_us,
      latency.p99_us, latency.max_us);
}

// Waits until a subscriber has received the first pose or the wait expires; shortened by a stop signal.
void PublisherLoop::wait_for_first_subscriber(Duration wait) {
  Time deadline = monotonic_now() + wait;
  bool shortened = false;
  while (!is_first_pose_delivered() && monotonic_now() < deadline) {
    pollfd waited{signals_, POLLIN, 0};
    poll(&waited, stopping_ ? 0 : 1, 10);
    note_signals();
    if (stopping_ && !shortened) {
      deadline = std::min(deadline, monotonic_now() + kMaxWaitWhenStopping);
      shortened = true;
    }
  }
  if (wait.ns > 0)
    spdlog::info("{} subscriber(s) found, {} poses waiting", publisher_->subscribers(), ring_.size());
}

// A matched subscriber may not have discovered this writer yet and receives nothing until then, and the
// history kept for it is short. Therefore the first pose is sent alone; the others follow once it is
// acknowledged.
bool PublisherLoop::is_first_pose_delivered() {
  if (publisher_->subscribers() == 0) return false;
  if (published_ == 0) {
    const auto records = ring_.begin_read();
    if (records.empty()) return stopping_;
    publish(records.front());
    ring_.consume(1);
  }
  return publisher_->wait_for_acknowledgments(kBacklogAcknowledgment);
}

void PublisherLoop::publish_pending() {
  // A pose is consumed only after it is written; a restarted process repeats an unfinished one.
  int in_a_row = 0;
  for (auto records = ring_.begin_read(); !records.empty(); records = ring_.begin_read()) {
    publish(records.front());
    ring_.consume(1);
    if (++in_a_row < dds::OdometryPublisher::kHistoryDepth - 2) continue;
    // Pause in a backlog: otherwise the history overwrites poses that reliable subscribers have not received.
    publisher_->wait_for_acknowledgments(kBacklogAcknowledgment);
    in_a_row = 0;
    note_signals();
    if (monotonic_now() >= next_report_) return;
  }
}

void PublisherLoop::publish(const ipc::PoseRecord& record) {
  const Time taken = monotonic_now();
  const bool odometry_written = publisher_->publish_odometry(record);
  const Time written = monotonic_now();
  const bool transform_written = publisher_->publish_transform(record);
  const bool report_written =
      publisher_->publish_scan_report(dds::make_scan_report(record, taken, written, host_id_));
  latency_->record(record, taken, written);
  latest_ = record;
  latest_taken_ = taken;
  ++published_;
  const std::uint64_t failed =
      (odometry_written ? 0U : 1U) + (transform_written ? 0U : 1U) + (report_written ? 0U : 1U);
  if (failed > 0 && failed_ == 0)
    spdlog::error("Fast DDS refused to write pose {}; further failures are counted in the latency report",
                  record.sequence);
  failed_ += failed;
}

// Returns false if a new process is needed.
bool PublisherLoop::report() {
  next_report_ = std::max(next_report_ + kReportPeriod, monotonic_now());
  publish_reports();
  if (parent_ != 0 && getppid() != parent_) {
    spdlog::warn("niliod (process {}) has ended", parent_);
    stopping_ = true;
  }
  switch (publisher_->participant().refresh_interfaces()) {
    case dds::Participant::Refresh::kUnchanged:
      return true;
    case dds::Participant::Refresh::kRescanned:
      spdlog::info("network interfaces changed; DDS uses the new ones");
      return true;
    case dds::Participant::Refresh::kNeedsRestart:
      spdlog::info("a listed DDS interface appeared; restarting to use it");
      return false;
  }
  return true;
}

void PublisherLoop::publish_reports() {
  fill_report();
  publisher_->publish_latency(report_);
  if (!latest_) return;
  publisher_->publish_diagnostics(
      dds::make_diagnostics(*latest_, Time{clock_ns(CLOCK_REALTIME)}, monotonic_now() - latest_taken_));
}

void PublisherLoop::fill_report() {
  const std::span<dds::StageLatency> rows(report_.stages);
  report_.stamp = Time{clock_ns(CLOCK_REALTIME)};
  latency_->fill(rows.first<PublishLatency::kRows>());
  report_.poses_published = published_;
  report_.failed_writes = failed_;
  report_.ring_dropped = ring_.dropped();
  report_.ring_high_water = ring_.high_water();
  if (!imu_poses_) return;
  const dds::ImuPoseLoop::Counts counts = imu_poses_->counts();
  report_.imu_poses_published = counts.published;
  report_.failed_writes += counts.failed_writes;
  report_.imu_ring_dropped = counts.ring_dropped;
  report_.imu_ring_high_water = counts.ring_high_water;
  imu_poses_->fill_latency(rows.last<dds::ImuPoseLoop::kLatencyRows>());
}

void PublisherLoop::sleep_until(Time time) {
  std::array<pollfd, 2> waited{pollfd{wake_event_.file_descriptor(), POLLIN, 0}, pollfd{signals_, POLLIN, 0}};
  const Duration left = std::max(time - monotonic_now(), Duration{0});
  const timespec timeout{left.ns / 1'000'000'000, left.ns % 1'000'000'000};
  ppoll(waited.data(), waited.size(), &timeout, nullptr);
  wake_event_.clear();
  note_signals();
}

void PublisherLoop::note_signals() {
  signalfd_siginfo signal{};
  while (read(signals_, &signal, sizeof signal) == sizeof signal) stopping_ = true;
}

}  // namespace nilio::daemon
