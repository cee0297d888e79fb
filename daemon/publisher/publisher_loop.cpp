#include "daemon/publisher/publisher_loop.hpp"

#include "nilio/core/clock.hpp"

#include "ipc/dds/reports.hpp"
#include "ipc/messages/diagnostics.hpp"

#include <algorithm>
#include <csignal>
#include <ctime>
#include <poll.h>
#include <span>
#include <sys/signalfd.h>
#include <unistd.h>
#include <utility>

#include <spdlog/spdlog.h>

namespace nilio::daemon {
namespace {

using core::Duration;
using core::Time;

constexpr Duration kReportPeriod{1'000'000'000};
constexpr Duration kLastAcknowledgments{500'000'000};

}  // namespace

PublisherLoop::PublisherLoop(pid_t parent, int signals, std::unique_ptr<dds::OdometryPublisher> publisher,
                             std::unique_ptr<dds::ScanPoseLoop> scan_poses,
                             std::unique_ptr<dds::ImuPoseLoop> imu_poses,
                             std::unique_ptr<dds::CloudLoop> clouds)
    : parent_(parent),
      signals_(signals),
      publisher_(std::move(publisher)),
      scan_poses_(std::move(scan_poses)),
      imu_poses_(std::move(imu_poses)),
      clouds_(std::move(clouds)) {
  report_.stages.resize(dds::PublishLatency::kRows + (imu_poses_ ? dds::ImuPoseLoop::kLatencyRows : 0));
}

int PublisherLoop::run() {
  Time next_report = monotonic_now();
  while (!stopping_) {
    if (monotonic_now() >= next_report) {
      next_report = std::max(next_report + kReportPeriod, monotonic_now());
      if (!report()) return kExitStartAgain;
    }
    if (!stopping_) sleep_until(next_report);
  }
  scan_poses_->stop();
  if (imu_poses_) imu_poses_->stop();
  publish_reports();
  const bool acknowledged = publisher_->wait_for_acknowledgments(kLastAcknowledgments);
  const dds::ScanPoseLoop::Counts counts = scan_poses_->counts();
  // Last: it may take its time under load, and has nothing that must be sent.
  if (clouds_) clouds_->stop();
  spdlog::info("stopped: {} poses published, {} writes failed{}{}{}", counts.published, counts.failed_writes,
               acknowledged ? "" : ", not all acknowledged by every subscriber", imu_summary(),
               cloud_summary());
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

std::string PublisherLoop::cloud_summary() const {
  const dds::CloudLoop::Counts counts = clouds_ ? clouds_->counts() : dds::CloudLoop::Counts{};
  if (counts.scans + counts.paths + counts.failed_writes == 0) return "";
  return fmt::format("; {} registered scans ({} superseded), {} paths, {} writes failed", counts.scans,
                     counts.dropped, counts.paths, counts.failed_writes);
}

bool PublisherLoop::report() {
  publish_reports();
  log_events();
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

void PublisherLoop::log_events() {
  if (!start_logged_ && scan_poses_->has_started()) {
    spdlog::info("{} subscriber(s) found", publisher_->subscribers());
    start_logged_ = true;
  }
  if (!failure_logged_ && scan_poses_->counts().failed_writes > 0) {
    spdlog::error(
        "Fast DDS refused to write a pose: subscribers miss it, and further failures are counted in the "
        "latency "
        "report - restart nilio-publisher, and check its interfaces");
    failure_logged_ = true;
  }
  if (const std::uint64_t jumps = imu_poses_ ? imu_poses_->counts().jumps : 0; jumps > imu_jumps_logged_) {
    spdlog::warn(
        "IMU-rate poses: {} correction(s) by scan poses were above publisher.imu_pose.jump_m or jump_deg and "
        "were "
        "applied at once; niliod's log has the reason",
        jumps - std::exchange(imu_jumps_logged_, jumps));
  }
  for (const std::string& line : publisher_->participant().take_conflicts()) spdlog::warn("{}", line);
}

void PublisherLoop::publish_reports() {
  fill_report();
  publisher_->publish_latency(report_);
  const auto latest = scan_poses_->latest();
  if (!latest) return;
  const dds::PoseCounts period = counted_ ? latest->counts - *counted_ : dds::PoseCounts{};
  counted_ = latest->counts;
  publisher_->publish_diagnostics(dds::make_diagnostics(
      {latest->record, monotonic_now() - latest->taken, period}, Time{clock_ns(CLOCK_REALTIME)}));
}

void PublisherLoop::fill_report() {
  const std::span<dds::StageLatency> rows(report_.stages);
  report_.stamp = Time{clock_ns(CLOCK_REALTIME)};
  scan_poses_->latency().fill(rows.first<dds::PublishLatency::kRows>());
  const dds::ScanPoseLoop::Counts scan_poses = scan_poses_->counts();
  report_.poses_published = scan_poses.published;
  report_.failed_writes = scan_poses.failed_writes;
  report_.ring_dropped = scan_poses.ring_dropped;
  report_.ring_high_water = scan_poses.ring_high_water;
  if (!imu_poses_) return;
  const dds::ImuPoseLoop::Counts imu_poses = imu_poses_->counts();
  report_.imu_poses_published = imu_poses.published;
  report_.failed_writes += imu_poses.failed_writes;
  report_.imu_ring_dropped = imu_poses.ring_dropped;
  report_.imu_ring_high_water = imu_poses.ring_high_water;
  imu_poses_->fill_latency(rows.last<dds::ImuPoseLoop::kLatencyRows>());
}

void PublisherLoop::sleep_until(Time time) {
  pollfd waited{signals_, POLLIN, 0};
  const timespec timeout = to_timespec(time - monotonic_now());
  ppoll(&waited, 1, &timeout, nullptr);
  signalfd_siginfo signal{};
  while (read(signals_, &signal, sizeof signal) == sizeof signal) stopping_ = true;
}

}  // namespace nilio::daemon
