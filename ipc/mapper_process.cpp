#include "ipc/mapper_process.hpp"

#include "nilio/core/clock.hpp"
#include "nilio/core/units.hpp"

#include "ipc/child_process.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <ctime>
#include <unistd.h>
#include <utility>

namespace nilio::ipc {
namespace {

// Seconds of keyframes while the mapper writes a file or restarts.
constexpr std::size_t kKeyframeSlots = 16;
// The mapper waits for room.
constexpr std::size_t kSubmapSlots = 4;
// Processes that may be killed while they complete a map.
constexpr std::size_t kMaxEnds = 3;

/// Name of this run among all that may write the same folder.
std::string make_session() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%lld.%09ld-%d", static_cast<long long>(now.tv_sec), now.tv_nsec,
                getpid());
  return text.data();
}

}  // namespace

const char* name_of(MapperLocalisation state) {
  constexpr std::array<const char*, 6> names{"off",       "loading",       "searching",
                                             "localised", "odometry only", "failed"};
  return names.at(static_cast<std::size_t>(state));
}

core::Result<std::unique_ptr<MapperProcess>> MapperProcess::create(MapperProcessConfig config) {
  auto keyframes = OverwritingRing<ScanCloud>::in_shared_memory(kKeyframeSlots);
  if (!keyframes) return core::Error{"keyframe ring for the mapper: " + keyframes.error().message};
  auto wake = WakeEvent::create();
  if (!wake) return core::Error{"wake event for the mapper: " + wake.error().message};
  auto state = SharedObject<MapperState>::create();
  if (!state) return core::Error{"state of the mapper: " + state.error().message};
  std::shared_ptr<OverwritingRing<SubmapCloud>> submaps;
  if (config.returns_submaps) {
    auto ring = OverwritingRing<SubmapCloud>::in_shared_memory(kSubmapSlots);
    if (!ring) return core::Error{"submap ring of the mapper: " + ring.error().message};
    submaps = std::make_shared<OverwritingRing<SubmapCloud>>(std::move(ring).value());
  }
  return std::unique_ptr<MapperProcess>(new MapperProcess(std::move(config), std::move(keyframes).value(),
                                                          std::move(wake).value(), std::move(state).value(),
                                                          std::move(submaps)));
}

MapperProcess::MapperProcess(MapperProcessConfig config, OverwritingRing<ScanCloud> keyframes, WakeEvent wake,
                             SharedObject<MapperState> state,
                             std::shared_ptr<OverwritingRing<SubmapCloud>> submaps)
    : config_(std::move(config)),
      session_(make_session()),
      keyframes_(std::move(keyframes)),
      wake_(std::move(wake)),
      state_(std::move(state)),
      submaps_(std::move(submaps)),
      process_("mapper", config_.start_interval,
               [this](bool) { return spawn(config_.publish && !is_ending_); }) {}

core::Result<pid_t> MapperProcess::spawn(bool publish) {
  std::vector<std::string> arguments{config_.executable.string(),
                                     "--parent-pid=" + std::to_string(getpid()),
                                     "--session=" + session_,
                                     "--range=" + std::to_string(config_.range_m),
                                     "--max-voxels=" + std::to_string(config_.max_voxels),
                                     "--domain=" + std::to_string(config_.domain),
                                     "--map-frame=" + config_.map_frame,
                                     "--odom-frame=" + config_.odom_frame,
                                     "--kept-submaps=" + std::to_string(config_.kept_submaps)};
  if (!config_.folder.empty()) arguments.push_back("--folder=" + config_.folder.string());
  if (!config_.saved_map.empty()) arguments.push_back("--map=" + config_.saved_map.string());
  if (!config_.localisation_file.empty())
    arguments.push_back("--localisation-file=" + config_.localisation_file.string());
  if (config_.continues_run) arguments.emplace_back("--continue");
  if (config_.keeps_all) arguments.emplace_back("--keep-all");
  if (!publish) arguments.emplace_back("--no-publish");
  if (!config_.closes_loops) arguments.emplace_back("--no-loops");
  if (!config_.topic_prefix.empty()) arguments.push_back("--topic-prefix=" + config_.topic_prefix);
  for (const std::string& address : config_.interface_whitelist)
    arguments.push_back("--interface=" + address);
  std::vector<int> inherited;
  const auto pass_on = [&](const char* option, int descriptor) {
    arguments.push_back(option +
                        std::to_string(kFirstInheritedDescriptor + static_cast<int>(inherited.size())));
    inherited.push_back(descriptor);
  };
  pass_on("--keyframe-ring-fd=", keyframes_.file_descriptor());
  pass_on("--wake-fd=", wake_.file_descriptor());
  pass_on("--state-fd=", state_.file_descriptor());
  if (submaps_) pass_on("--submap-ring-fd=", submaps_->file_descriptor());
  auto pid = spawn_child(std::move(arguments), inherited);
  if (!pid) return core::Error{"cannot start the mapper " + pid.error().message};
  taken_ = keyframes_.taken();
  progress_at_ = Clock::now();
  return pid;
}

void MapperProcess::push(const ScanCloud& keyframe) noexcept {
  keyframes_.push(keyframe, keyframe.bytes());
  wake_.notify();
}

std::optional<ProcessEvent> MapperProcess::poll() {
  const auto now = Clock::now();
  const std::uint64_t taken = keyframes_.taken();
  if (std::exchange(taken_, taken) != taken || taken == keyframes_.written()) progress_at_ = now;
  if (running() && now - progress_at_ > std::chrono::nanoseconds(config_.hang_timeout.ns)) {
    progress_at_ = now;
    return process_.kill_hung("has read no waiting keyframe for " +
                              std::to_string(config_.hang_timeout.ns / kNanosecondsPerSecond) + " s");
  }
  return process_.poll();
}

void MapperProcess::request_stop(core::Duration timeout) {
  state_->stop_deadline_ns.store(monotonic_ns() + timeout.ns);
  process_.request_stop();
}

std::vector<ProcessEvent> MapperProcess::stop(core::Duration timeout) {
  const auto seconds = [](core::Duration duration) {
    return std::to_string(duration.ns / kNanosecondsPerSecond);
  };
  const auto deadline = Clock::now() + std::chrono::nanoseconds(timeout.ns);
  state_->stop_deadline_ns.store(monotonic_ns() + timeout.ns);
  std::vector<ProcessEvent> events;
  // No time for DDS to start.
  is_ending_ = true;
  while (true) {
    std::uint64_t beats = state_->heartbeat.load();
    auto beat_at = Clock::now();
    const auto hangs = [&] {
      const auto now = Clock::now();
      if (std::exchange(beats, state_->heartbeat.load()) != beats) beat_at = now;
      return now - beat_at > std::chrono::nanoseconds(config_.stop_hang_timeout.ns);
    };
    const auto left = std::max(deadline - Clock::now(), Clock::duration::zero());
    auto ended = process_.stop({std::chrono::nanoseconds(left).count()}, hangs);
    const bool was_killed = !ended || ended->exit_status < 0;
    if (was_killed && ended)
      ended->message += Clock::now() >= deadline ? " because the map was not complete in time"
                        : hangs()
                            ? " because it made no progress for " + seconds(config_.stop_hang_timeout) + " s"
                            : " while it completed the map";
    if (ended) events.push_back(*ended);
    if (!was_killed || events.size() >= kMaxEnds || Clock::now() >= deadline) return events;
    if (auto started = process_.restart(); !started) return events;
  }
}

/// Runs another mapper with these arguments to its end.
core::Result<std::monostate> MapperProcess::run_once(std::vector<std::string> arguments,
                                                     core::Duration timeout) const {
  arguments.insert(arguments.begin(),
                   {config_.executable.string(), "--parent-pid=" + std::to_string(getpid())});
  RestartedProcess process("mapper", config_.start_interval,
                           [&](bool) { return spawn_child(arguments, {}); });
  if (auto started = process.start(); !started) return started.error();
  const auto ended = process.wait(timeout);
  if (ended.exit_status == 0) return std::monostate{};
  return core::Error{ended.message};
}

core::Result<std::monostate> MapperProcess::correct_trajectory(const std::filesystem::path& trajectory,
                                                               core::Duration timeout) const {
  const auto done =
      run_once({"--folder=" + config_.folder.string(), "--trajectory=" + trajectory.string()}, timeout);
  if (done) return done;
  return core::Error{trajectory.string() + ": not corrected, the " + done.error().message +
                     " - nilio map close corrects it"};
}

core::Result<std::monostate> MapperProcess::export_map(const std::filesystem::path& output,
                                                       core::Duration timeout) const {
  const auto done = run_once({"--folder=" + config_.folder.string(), "--export=" + output.string()}, timeout);
  if (done) return done;
  return core::Error{output.string() + ": not complete, the " + done.error().message +
                     " - nilio map export writes it"};
}

core::Result<std::monostate> MapperProcess::localise_trajectory(const std::filesystem::path& trajectory,
                                                                core::Duration timeout) const {
  const auto done = run_once(
      {"--localisation-file=" + config_.localisation_file.string(), "--trajectory=" + trajectory.string()},
      timeout);
  if (done) return done;
  return core::Error{trajectory.string() + ": not moved into the frame of the saved map, the " +
                     done.error().message + " - localisation.txt has the transforms"};
}

}  // namespace nilio::ipc
