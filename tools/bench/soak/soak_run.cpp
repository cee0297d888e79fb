#include "tools/bench/soak/soak_run.hpp"

#include "daemon/config/schema.hpp"
#include "daemon/input/input.hpp"
#include "daemon/odometry/pipeline.hpp"
#include "ipc/histogram.hpp"
#include "ipc/publisher_process.hpp"
#include "tools/bench/common/looping_source.hpp"
#include "tools/bench/common/memory_use.hpp"
#include "tools/common/child_process.hpp"

#include <algorithm>
#include <memory>
#include <unistd.h>
#include <utility>

namespace nilio::tools::bench {

namespace {

using core::Duration;
using core::Error;
using core::Result;

constexpr Duration kSamplePeriod = Duration::from_seconds(1.0);
constexpr std::int64_t kMinuteNs = 60'000'000'000;
constexpr double kKibibyte = 1024.0;
/// Bounded, because notes take memory of the process that is measured.
constexpr std::size_t kMaxNotes = 20;

/// Memory samples of a process. All room is allocated and touched beforehand, because this process is
/// measured.
class MemorySampler {
 public:
  MemorySampler(std::string name, pid_t process, Duration length) : process_(process) {
    series_.name = std::move(name);
    const auto maximum = static_cast<std::size_t>(length.ns / kSamplePeriod.ns) + 2;
    series_.minutes.assign(maximum, 0.0);
    series_.kib.assign(maximum, 0.0);
  }

  void sample(Duration since_begin) {
    if (count_ == series_.minutes.size()) return;
    const auto memory = resident_memory(process_);
    if (!memory) return;
    series_.minutes[count_] = since_begin.seconds() / kMinuteS;
    series_.kib[count_] = static_cast<double>(memory->anonymous) / kKibibyte;
    ++count_;
  }

  MemorySeries take(Duration warm_up) {
    series_.minutes.resize(count_);
    series_.kib.resize(count_);
    const auto from = static_cast<std::size_t>(
        std::lower_bound(series_.minutes.begin(), series_.minutes.end(), warm_up.seconds() / kMinuteS) -
        series_.minutes.begin());
    series_.fit = fit_line(std::span(series_.minutes).subspan(from), std::span(series_.kib).subspan(from));
    return std::move(series_);
  }

 private:
  pid_t process_;
  MemorySeries series_;
  std::size_t count_ = 0;
};

/// Opens the first drive, with the loop in place of its files.
Result<daemon::Input> open_loop(std::span<const SensorDrive> drives, const daemon::Config& config,
                                const LoopPlan& plan) {
  Result<daemon::Input> input = daemon::open_replay(drives.front().files, config);
  if (!input) return input;
  for (const SensorDrive& drive : drives.subspan(1)) {
    const Result<daemon::Input> other = daemon::open_replay(drive.files, config);
    if (!other) return other.error();
    if (other->sensor->model != input->sensor->model)
      return Error{drive.name + ": has another LiDAR (" + other->sensor->name + ") than " +
                   drives.front().name + " (" + input->sensor->name + ")"};
  }
  auto packets = loop_packets(plan);
  if (!packets) return packets.error();
  input->packets = std::move(packets).value();
  input->first_stamp = plan.begin();
  if (!input->frames) return input;
  auto frames = loop_frames(plan);
  if (!frames) return frames.error();
  input->frames = std::move(frames).value();
  return input;
}

class SoakRun {
 public:
  SoakRun(std::span<const SensorDrive> drives, const SoakConfig& config, StopSignals& signals)
      : drives_(drives), config_(config), signals_(signals) {}

  Result<SoakResult> run();

 private:
  Result<std::monostate> open();
  Result<std::monostate> start_publisher();
  void note(const std::string& line) {
    if (result_.notes.size() < kMaxNotes) result_.notes.push_back(line);
  }
  void drain();
  void take(const ipc::PoseRecord& record);
  [[nodiscard]] bool is_ending() const;
  void sample(core::Time stamp);
  SoakResult finish(std::int64_t begun_ns);

  std::span<const SensorDrive> drives_;
  const SoakConfig& config_;
  StopSignals& signals_;
  LoopPlan plan_;
  std::unique_ptr<ipc::PublisherProcess> publisher_;
  std::unique_ptr<daemon::Pipeline> pipeline_;
  std::unique_ptr<ipc::LatencyHistograms> latency_ = std::make_unique<ipc::LatencyHistograms>();
  std::optional<MemorySampler> own_memory_;
  std::optional<MemorySampler> publisher_memory_;
  std::optional<core::Time> first_stamp_;
  core::Time last_stamp_;
  core::Time next_sample_;
  StationaryDrift drift_;
  SoakResult result_;
};

Result<std::monostate> SoakRun::start_publisher() {
  const auto executable = find_sibling_program("nilio-publisher");
  if (!executable) {
    result_.notes.push_back(executable.error().message + "; its memory is not measured");
    return std::monostate{};
  }
  ipc::PublisherProcessConfig config;
  config.executable = *executable;
  config.domain = config_.domain;
  config.interface_whitelist = {"127.0.0.1"};
  auto publisher = ipc::PublisherProcess::create(std::move(config));
  if (!publisher) return publisher.error();
  publisher_ = std::move(publisher).value();
  const Result<pid_t> pid = publisher_->start();
  if (!pid) return pid.error();
  publisher_memory_.emplace("nilio-publisher", *pid, config_.length);
  return std::monostate{};
}

Result<std::monostate> SoakRun::open() {
  auto plan = plan_laps(drives_, config_.length);
  if (!plan) return plan.error();
  plan_ = std::move(plan).value();
  daemon::Config config = drives_.front().config;
  if (auto applied = daemon::apply_overrides(config, config_.overrides); !applied) return applied;
  Result<daemon::Input> input = open_loop(drives_, config, plan_);
  if (!input) return input.error();
  if (auto started = start_publisher(); !started) return started;
  auto pipeline = daemon::Pipeline::create(config, std::move(input).value(), {}, publisher_.get());
  if (!pipeline) return pipeline.error();
  pipeline_ = std::move(pipeline).value();
  own_memory_.emplace("pipeline", getpid(), config_.length);
  return std::monostate{};
}

/// True at the end of the recording: threads that end return memory.
bool SoakRun::is_ending() const {
  return pipeline_->lidars().front()->state.ended.load() ||
         (pipeline_->input().frames && pipeline_->imu_state().ended.load());
}

void SoakRun::sample(core::Time stamp) {
  if (stamp < next_sample_ || is_ending()) return;
  next_sample_ = stamp + kSamplePeriod;
  own_memory_->sample(stamp - *first_stamp_);
  // A restarted publisher is another process; restarts are counted.
  if (publisher_ && publisher_->restarts() == 0) publisher_memory_->sample(stamp - *first_stamp_);
}

void SoakRun::take(const ipc::PoseRecord& record) {
  latency_->record(record);
  ++result_.poses;
  ++result_.states[static_cast<std::size_t>(record.state) % result_.states.size()];
  result_.map_voxels = record.map_voxels;
  last_stamp_ = {record.stamp_ns};
  if (!first_stamp_) first_stamp_ = last_stamp_;
  if (config_.stationary && record.state != ipc::TrackingState::kInitialising)
    drift_.add(last_stamp_, core::Vector3(record.position[0], record.position[1], record.position[2]));
  sample(last_stamp_);
}

void SoakRun::drain() {
  while (const auto record = pipeline_->poses().try_pop()) take(*record);
  while (pipeline_->imu_health().try_pop()) {
  }
  while (const auto line = pipeline_->event_log().take()) {
    if (line->level != daemon::LogLevel::kInfo) note(line->text);
  }
}

SoakResult SoakRun::finish(std::int64_t begun_ns) {
  result_.wall_seconds = static_cast<double>(monotonic_ns() - begun_ns) * 1e-9;
  result_.recorded_minutes = first_stamp_ ? (last_stamp_ - *first_stamp_).seconds() / kMinuteS : 0.0;
  result_.laps = plan_.laps.size();
  result_.scans = pipeline_->counters().scans.load();
  result_.scans_with_imu = pipeline_->counters().scans_with_imu.load();
  result_.packets_dropped = pipeline_->packets_dropped();
  // Without the last stage, end to end, whose histogram is corrected for coordinated omission.
  for (std::size_t i = 0; i + 1 < ipc::kLatencyStageCount; ++i)
    result_.recorded.emplace_back(ipc::kLatencyStageNames[i],
                                  latency_->histogram(static_cast<ipc::LatencyStage>(i)).snapshot().count());
  if (publisher_) {
    result_.publisher_restarts = publisher_->restarts();
    result_.publisher_dropped = publisher_->ring().dropped();
    result_.publisher = publisher_memory_->take(config_.warm_up);
  }
  result_.pipeline = own_memory_->take(config_.warm_up);
  result_.max_pose_m = drift_.max_pose_m();
  result_.max_minute_m = drift_.max_minute_m();
  return std::move(result_);
}

Result<SoakResult> SoakRun::run() {
  if (auto opened = open(); !opened) return opened.error();
  const std::int64_t begun_ns = monotonic_ns();
  const auto started = pipeline_->start();
  if (!started) return started.error();
  bool interrupted = false;
  while (!pipeline_->finished() && !interrupted) {
    pipeline_->output_event().wait(kPoll);
    drain();
    if (publisher_) {
      if (const auto event = publisher_->poll()) note(event->message);
    }
    interrupted = signals_.wait(Duration{});
  }
  pipeline_->request_stop();
  pipeline_->join();
  drain();
  if (publisher_) publisher_->stop();
  if (interrupted) return Error{"interrupted"};
  if (result_.poses == 0) return Error{drives_.front().name + ": gave no poses"};
  return finish(begun_ns);
}

}  // namespace

Result<SoakResult> run_soak(std::span<const SensorDrive> drives, const SoakConfig& config,
                            StopSignals& signals) {
  return SoakRun(drives, config, signals).run();
}

void StationaryDrift::add(core::Time stamp, const core::Vector3& position) {
  if (!begin_) begin_ = stamp;
  const std::int64_t minute = (stamp - *begin_).ns / kMinuteNs;
  if (minute != minute_) end_minute();
  minute_ = minute;
  sum_ += position;
  ++count_;
  if (mean_) {
    max_pose_m_ = std::max(max_pose_m_, (position - *mean_).norm());
  } else {
    first_minute_.push_back(position);
  }
}

void StationaryDrift::end_minute() {
  const core::Vector3 mean = sum_ / static_cast<double>(count_);
  sum_.setZero();
  count_ = 0;
  if (mean_) {
    max_minute_m_ = std::max(max_minute_m_, (mean - *mean_).norm());
    return;
  }
  mean_ = mean;
  for (const core::Vector3& position : first_minute_)
    max_pose_m_ = std::max(max_pose_m_, (position - mean).norm());
}

}  // namespace nilio::tools::bench
