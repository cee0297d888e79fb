#include "ipc/publisher_process.hpp"

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <sched.h>
#include <spawn.h>
#include <unistd.h>
#include <utility>

namespace nilio::ipc {
namespace {

// First inherited descriptor of the child: after standard input, output and error, and no gaps.
constexpr int kFirstDescriptor = 3;
constexpr std::array<const char*, 6> kDescriptorOptions{
    "--ring-fd=", "--wake-fd=", "--imu-pose-ring-fd=", "--imu-ring-fd=", "--imu-wake-fd=", "--state-fd="};
// Scan poses for the IMU-rate thread, which reads them at once; they queue up only during a restart.
constexpr std::size_t kImuPoseSlots = 64;
// After a restart, queued poses wait this long until subscribers have found the new process.
constexpr core::Duration kRediscovery{1'000'000'000};

std::chrono::nanoseconds chrono(core::Duration duration) { return std::chrono::nanoseconds(duration.ns); }

std::string describe(core::Duration duration) { return std::to_string(duration.ns / 1'000'000) + " ms"; }

// Copy of a descriptor above the numbers that the child's descriptors will use.
class DescriptorCopy {
 public:
  explicit DescriptorCopy(int original) : copy_(fcntl(original, F_DUPFD_CLOEXEC, 16)) {}
  DescriptorCopy(DescriptorCopy&& other) noexcept : copy_(std::exchange(other.copy_, -1)) {}
  ~DescriptorCopy() {
    if (copy_ >= 0) close(copy_);
  }
  DescriptorCopy(const DescriptorCopy&) = delete;
  DescriptorCopy& operator=(const DescriptorCopy&) = delete;
  DescriptorCopy& operator=(DescriptorCopy&&) = delete;
  [[nodiscard]] int get() const { return copy_; }

 private:
  int copy_;
};

// Spawn attributes of the child. Signals have their defaults; SIGTERM and SIGINT are blocked until the child
// reads them from its signalfd. It has its own process group: Ctrl-C on the terminal reaches only niliod,
// which then stops it in order. Normal scheduling, whatever the calling thread has.
void set_attributes(posix_spawnattr_t& attributes) {
  sigset_t blocked;
  sigemptyset(&blocked);
  sigaddset(&blocked, SIGTERM);
  sigaddset(&blocked, SIGINT);
  sigset_t defaults;
  sigfillset(&defaults);
  const sched_param normal{};
  posix_spawnattr_setsigmask(&attributes, &blocked);
  posix_spawnattr_setsigdefault(&attributes, &defaults);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setschedpolicy(&attributes, SCHED_OTHER);
  posix_spawnattr_setschedparam(&attributes, &normal);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF |
                                            POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSCHEDULER);
}

int spawn_with_descriptors(const std::string& executable, char* const* argv,
                           const std::vector<DescriptorCopy>& descriptors, pid_t& pid) {
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  int next = kFirstDescriptor;
  for (const DescriptorCopy& descriptor : descriptors)
    posix_spawn_file_actions_adddup2(&actions, descriptor.get(), next++);
  posix_spawn_file_actions_addclosefrom_np(&actions, next);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  set_attributes(attributes);
  const int failure = posix_spawn(&pid, executable.c_str(), &actions, &attributes, argv, environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  return failure;
}

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
  auto wake = WakeEvent::create();
  auto imu_wake = WakeEvent::create();
  if (!wake || !imu_wake)
    return core::Error{"wake event for the publisher: " + (wake ? imu_wake : wake).error().message};
  return PublisherRings{std::move(poses).value(),   std::move(wake).value(),     std::move(imu_poses).value(),
                        std::move(samples).value(), std::move(imu_wake).value(), std::move(state).value()};
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
  int descriptor = kFirstDescriptor;
  for (const char* option : kDescriptorOptions) arguments.push_back(option + std::to_string(descriptor++));
  if (config_.priority > 0) arguments.push_back("--priority=" + std::to_string(config_.priority));
  if (!config_.imu_poses) return arguments;
  add_imu_arguments(*config_.imu_poses, arguments);
  if (config_.imu_pose_priority > 0)
    arguments.push_back("--imu-priority=" + std::to_string(config_.imu_pose_priority));
  return arguments;
}

core::Result<pid_t> PublisherProcess::spawn(core::Duration wait_for_subscribers) {
  // In the order of kDescriptorOptions.
  std::vector<DescriptorCopy> descriptors;
  for (const int descriptor :
       {rings_.poses.file_descriptor(), rings_.wake.file_descriptor(), rings_.imu_poses.file_descriptor(),
        rings_.samples.file_descriptor(), rings_.imu_wake.file_descriptor(), rings_.state.file_descriptor()})
    descriptors.emplace_back(descriptor);
  std::vector<std::string> strings = arguments(wait_for_subscribers);
  std::vector<char*> argv;
  argv.reserve(strings.size() + 1);
  for (std::string& argument : strings) argv.push_back(argument.data());
  argv.push_back(nullptr);
  pid_t pid = -1;
  const int failure = spawn_with_descriptors(strings.front(), argv.data(), descriptors, pid);
  if (failure != 0)
    return core::Error{"cannot start the publisher " + strings.front() + ": " + std::strerror(failure)};
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
