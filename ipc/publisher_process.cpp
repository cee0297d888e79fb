#include "ipc/publisher_process.hpp"

#include "ipc/child_process.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <unistd.h>
#include <utility>

namespace nilio::ipc {
namespace {

// In the order of the inherited descriptors.
constexpr std::array<const char*, 9> kDescriptorOptions{
    "--ring-fd=",  "--wake-fd=",      "--imu-pose-ring-fd=", "--imu-ring-fd=",  "--imu-wake-fd=",
    "--state-fd=", "--scan-ring-fd=", "--path-ring-fd=",     "--cloud-wake-fd="};
// Scan poses for the IMU-rate thread, which reads them at once; they queue up only during a restart.
constexpr std::size_t kImuPoseSlots = 64;
// A scan is read within milliseconds, or superseded.
constexpr std::size_t kScanSlots = 4;
// After a restart, queued poses wait this long until subscribers have found the new process.
constexpr core::Duration kRediscovery{1'000'000'000};

std::chrono::nanoseconds chrono(core::Duration duration) { return std::chrono::nanoseconds(duration.ns); }

std::string describe(core::Duration duration) { return std::to_string(duration.ns / 1'000'000) + " ms"; }

// 17 digits reproduce a double exactly.
std::string exact(double value) {
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%.17g", value);
  return text.data();
}

void add_imu_arguments(const ImuPoseConfig& config, std::vector<std::string>& arguments) {
  const core::ImuRateOdometryConfig& propagation = config.propagation;
  const core::PoseSlewLimits& slew = config.slew;
  const auto& q = propagation.T_base_imu.rotation;
  const core::Vector3& p = propagation.T_base_imu.translation;
  const auto add = [&](const char* option, double value) { arguments.push_back(option + exact(value)); };
  arguments.emplace_back("--imu-rate");
  arguments.push_back("--imu-orientation=" + exact(q.x()) + "," + exact(q.y()) + "," + exact(q.z()) + "," +
                      exact(q.w()));
  arguments.push_back("--imu-position=" + exact(p.x()) + "," + exact(p.y()) + "," + exact(p.z()));
  add("--imu-max-gap=", propagation.max_gap.seconds());
  add("--imu-max-age=", propagation.max_age.seconds());
  add("--imu-rate-max-hz=", config.max_rate_hz);
  add("--imu-max-slew=", slew.max_slew_m_s);
  add("--imu-max-turn-slew=", slew.max_slew_rad_s);
  add("--imu-settle=", slew.settle.seconds());
  add("--imu-jump=", slew.jump_m);
  add("--imu-turn-jump=", slew.jump_rad);
}

}  // namespace

core::Result<PublisherRings> PublisherRings::create(std::size_t pose_slots, std::size_t sample_slots) {
  auto poses = Ring<PoseRecord>::in_shared_memory(pose_slots);
  if (!poses) return core::Error{"pose ring for the publisher: " + poses.error().message};
  auto imu_poses = Ring<PoseRecord>::in_shared_memory(kImuPoseSlots);
  if (!imu_poses) return core::Error{"second pose ring for the publisher: " + imu_poses.error().message};
  auto samples = Ring<ImuRecord>::in_shared_memory(sample_slots);
  if (!samples) return core::Error{"IMU ring for the publisher: " + samples.error().message};
  auto state = SharedObject<PublisherState>::create();
  if (!state) return core::Error{"state of the publisher: " + state.error().message};
  auto scans = OverwritingRing<ScanCloud>::in_shared_memory(kScanSlots);
  if (!scans) return core::Error{"scan ring for the publisher: " + scans.error().message};
  auto path = OverwritingRing<PathPose>::in_shared_memory(kMaxPathPoses + 1);
  if (!path) return core::Error{"path ring for the publisher: " + path.error().message};
  std::array<core::Result<WakeEvent>, 3> events{WakeEvent::create(), WakeEvent::create(),
                                                WakeEvent::create()};
  for (const auto& event : events) {
    if (!event) return core::Error{"wake event for the publisher: " + event.error().message};
  }
  return PublisherRings{
      std::move(poses).value(),   std::move(events[0]).value(), std::move(imu_poses).value(),
      std::move(samples).value(), std::move(events[1]).value(), std::move(state).value(),
      std::move(scans).value(),   std::move(path).value(),      std::move(events[2]).value()};
}

core::Result<std::unique_ptr<PublisherProcess>> PublisherProcess::create(PublisherProcessConfig config) {
  auto rings = PublisherRings::create(config.ring_capacity, config.sample_ring_capacity);
  if (!rings) return rings.error();
  return std::unique_ptr<PublisherProcess>(new PublisherProcess(std::move(config), std::move(rings).value()));
}

PublisherProcess::PublisherProcess(PublisherProcessConfig config, PublisherRings rings)
    : config_(std::move(config)),
      rings_(std::move(rings)),
      process_("publisher", config_.start_interval, [this](bool again) {
        return spawn(again ? std::max(config_.wait_for_subscribers, kRediscovery)
                           : config_.wait_for_subscribers);
      }) {}

bool PublisherProcess::publish(const PoseRecord& record) noexcept {
  const bool pushed = rings_.poses.try_push(record);
  rings_.wake.notify();
  if (config_.imu_poses) {
    rings_.imu_poses.try_push(record);
    rings_.imu_wake.notify();
  }
  return pushed;
}

bool PublisherProcess::publish_sample(const ImuRecord& record) noexcept {
  if (!config_.imu_poses) return false;
  const bool pushed = rings_.samples.try_push(record);
  rings_.imu_wake.notify();
  return pushed;
}

void PublisherProcess::publish_scan(const ScanCloud& scan) noexcept {
  rings_.scans.push(scan, scan.bytes());
  rings_.cloud_wake.notify();
}

std::vector<std::string> PublisherProcess::arguments(core::Duration wait_for_subscribers) const {
  std::vector<std::string> arguments{
      config_.executable.string(),
      "--parent-pid=" + std::to_string(getpid()),
      "--domain=" + std::to_string(config_.domain),
      "--odom-frame=" + config_.odom_frame,
      "--base-frame=" + config_.base_frame,
      "--nice=" + std::to_string(config_.nice),
      "--wait-for-subscribers=" + std::to_string(wait_for_subscribers.seconds())};
  if (config_.lock_memory) arguments.emplace_back("--lock-memory");
  if (!config_.topic_prefix.empty()) arguments.push_back("--topic-prefix=" + config_.topic_prefix);
  if (!config_.transform) arguments.emplace_back("--no-transform");
  for (const std::string& address : config_.interface_whitelist)
    arguments.push_back("--interface=" + address);
  int descriptor = kFirstInheritedDescriptor;
  for (const char* option : kDescriptorOptions) arguments.push_back(option + std::to_string(descriptor++));
  arguments.push_back("--scan-points=" + std::to_string(config_.scan_points));
  arguments.push_back("--scan-rate-max-hz=" + exact(config_.scan_rate_max_hz));
  arguments.push_back("--path-poses=" + std::to_string(config_.path_poses));
  if (config_.priority > 0) arguments.push_back("--priority=" + std::to_string(config_.priority));
  if (!config_.imu_poses) return arguments;
  add_imu_arguments(*config_.imu_poses, arguments);
  if (config_.imu_pose_priority > 0)
    arguments.push_back("--imu-priority=" + std::to_string(config_.imu_pose_priority));
  return arguments;
}

core::Result<pid_t> PublisherProcess::spawn(core::Duration wait_for_subscribers) {
  const auto pid = spawn_child(
      arguments(wait_for_subscribers),
      {rings_.poses.file_descriptor(), rings_.wake.file_descriptor(), rings_.imu_poses.file_descriptor(),
       rings_.samples.file_descriptor(), rings_.imu_wake.file_descriptor(), rings_.state.file_descriptor(),
       rings_.scans.file_descriptor(), rings_.path.file_descriptor(), rings_.cloud_wake.file_descriptor()});
  if (!pid) return core::Error{"cannot start the publisher " + pid.error().message};
  reset_progress(Clock::now() + chrono(wait_for_subscribers));
  return pid;
}

std::optional<PublisherEvent> PublisherProcess::poll() {
  if (running() && is_hung()) {
    reset_progress(Clock::now());
    return PublisherEvent{
        process_.kill_hung("has read no waiting data for " + describe(config_.hang_timeout))};
  }
  auto event = process_.poll();
  if (!event) return std::nullopt;
  return PublisherEvent{std::move(*event)};
}

std::optional<PublisherEvent> PublisherProcess::stop(core::Duration timeout) {
  auto stopped = process_.stop(timeout);
  if (!stopped) return std::nullopt;
  PublisherEvent event{std::move(*stopped), rings_.poses.size()};
  if (event.unpublished > 0)
    event.message += ", " + std::to_string(event.unpublished) + " poses not published";
  return event;
}

void PublisherProcess::reset_progress(Clock::time_point at) {
  pose_progress_ = {rings_.poses.consumed(), at};
  sample_progress_ = {rings_.samples.consumed(), at};
}

bool PublisherProcess::is_hung() {
  const auto now = Clock::now();
  const auto stands_still = [&](const auto& ring, Progress& progress) {
    if (const std::uint64_t consumed = ring.consumed(); consumed != progress.consumed || ring.size() == 0)
      progress = {consumed, std::max(progress.at, now)};
    return now - progress.at > chrono(config_.hang_timeout);
  };
  const bool poses = stands_still(rings_.poses, pose_progress_);
  const bool samples = stands_still(rings_.samples, sample_progress_);
  return poses || samples;
}

}  // namespace nilio::ipc
