#include "daemon/output/supervisor.hpp"

#include "daemon/config/convert.hpp"
#include "daemon/config/schema.hpp"
#include "daemon/odometry/decision_log.hpp"
#include "daemon/odometry/pipeline.hpp"
#include "daemon/output/run_output.hpp"
#include "daemon/output/run_reports.hpp"
#include "daemon/realtime/memory_plan.hpp"
#include "ipc/histogram.hpp"
#include "ipc/publisher_process.hpp"

#include <array>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

namespace nilio::daemon {

namespace {

using core::Duration;
using core::Error;
using core::Result;

constexpr Duration kPollPeriod = Duration::from_milliseconds(20.0);
constexpr std::int64_t kStatusPeriodNs = 1'000'000'000;
constexpr std::int64_t kSilenceNs = 2'000'000'000;
constexpr std::size_t kPublisherSlots = 1024;

/// State of the supervisor during one run.
class Supervisor {
 public:
  Supervisor(const Config& config, const RunOptions& options) : config_(config), options_(options) {}

  Result<std::monostate> open();
  Result<std::monostate> run(const std::atomic<bool>& stop);

 private:
  Result<std::monostate> open_publisher(bool live);
  Result<std::monostate> open_output(const Input& input);
  void drain();
  void report_plan(const std::vector<PlanOutcome>& outcomes);
  void report_clock(const ipc::PoseRecord& record);
  void watch_publisher();
  void watch_can();
  void report_status();
  void report_silence(std::int64_t now);
  void report_feed();
  void report_mixed_senders();
  void report_end() const;
  void report_unused_imu() const;
  [[nodiscard]] nlohmann::json summary() const;

  const Config& config_;
  const RunOptions& options_;
  std::unique_ptr<ipc::PublisherProcess> publisher_;
  std::unique_ptr<Pipeline> pipeline_;
  std::unique_ptr<CanWatch> can_watch_;
  std::unique_ptr<RunOutput> output_;
  ipc::LatencyHistograms latency_;
  BudgetReport budget_;
  ImuReport imu_report_;
  /// Outcomes of the requests to the kernel, one line each.
  std::vector<std::string> plan_lines_;
  std::optional<ipc::PoseRecord> last_;
  std::uint64_t poses_ = 0;
  std::uint64_t poses_at_last_status_ = 0;
  std::array<std::uint64_t, 4> states_{};
  ipc::TrackingState reported_state_ = ipc::TrackingState::kInitialising;
  std::int64_t started_ns_ = 0;
  std::int64_t next_status_ns_ = 0;
  std::int64_t last_pose_ns_ = 0;
  bool silence_reported_ = false;
  /// Sections of the LiDARs already reported for mixed senders.
  std::set<std::string> mixed_reported_;
};

Result<std::monostate> Supervisor::open_publisher(bool live) {
  if (!config_.publisher.enabled) return std::monostate{};
  ipc::PublisherProcessConfig config;
  config.executable = options_.publisher_executable;
  config.domain = static_cast<std::uint32_t>(config_.publisher.domain);
  config.interface_whitelist = config_.publisher.interfaces;
  config.odom_frame = config_.publisher.odom_frame;
  config.base_frame = config_.publisher.base_frame;
  config.topic_prefix = config_.publisher.topic_prefix;
  config.ring_capacity = kPublisherSlots;
  if (config_.imu.enabled && config_.publisher.imu_rate) config.imu_poses = imu_pose_config(config_);
  const Result<ThreadPlan> plan = make_thread_plan(config_, live);
  if (!plan) return plan.error();
  if (plan->fifo) config.imu_pose_priority = config_.realtime.imu_pose_priority;
  config.lock_memory = plan->lock_memory;
  config.wait_for_subscribers = Duration::from_seconds(config_.publisher.wait_for_subscribers_s);
  auto publisher = ipc::PublisherProcess::create(std::move(config));
  if (!publisher) return publisher.error();
  publisher_ = std::move(publisher).value();
  const Result<pid_t> pid = publisher_->start();
  if (pid) {
    spdlog::info("nilio-publisher started, pid {}, DDS domain {}", *pid, config_.publisher.domain);
  } else {
    spdlog::error("{}; poses continue without DDS, the start will be repeated", pid.error().message);
  }
  return std::monostate{};
}

Result<std::monostate> Supervisor::open_output(const Input& input) {
  if (options_.output_folder.empty()) return std::monostate{};
  RunOutput::Options options;
  options.folder = options_.output_folder;
  options.T_camera_lidar = input.T_camera_lidar;
  options.T_base_lidar = odometry_config(config_).T_base_lidar;
  options.map = config_.output.map;
  options.map_voxel_m = config_.output.map_voxel_m;
  auto output = RunOutput::create(options, to_yaml(config_));
  if (!output) return output.error();
  output_ = std::move(output).value();
  return std::monostate{};
}

Result<std::monostate> Supervisor::open() {
  Result<Input> input = options_.replay ? open_replay(options_.files, config_) : open_live(config_);
  if (!input) return input.error();
  for (const std::string& note : input->notes) spdlog::info("{}", note);
  for (const std::string& warning : input->warnings) spdlog::warn("{}", warning);
  if (auto opened = open_output(*input); !opened) return opened;
  if (auto opened = open_publisher(input->live || options_.as_live); !opened) return opened;
  can_watch_ = std::move(input->can_watch);
  PipelineOptions pipeline_options;
  pipeline_options.paced = options_.paced;
  pipeline_options.as_live = options_.as_live;
  pipeline_options.thread_hook = options_.thread_hook;
  if (!options_.decisions_file.empty()) {
    auto decisions = read_decisions(options_.decisions_file);
    if (!decisions) return decisions.error();
    if (decisions->empty()) return Error{options_.decisions_file + ": contains no decision"};
    pipeline_options.decisions = std::move(decisions).value();
  }
  pipeline_options.collect_map = output_ != nullptr && config_.output.map;
  auto pipeline = Pipeline::create(config_, std::move(input).value(), pipeline_options, publisher_.get());
  if (!pipeline) return pipeline.error();
  pipeline_ = std::move(pipeline).value();
  if (output_ && pipeline_->has_live_rules()) {
    const core::BudgetConfig& budget = pipeline_->budget();
    return output_->open_decisions(
        decision_header(budget.mode, static_cast<double>(budget.budget.ns) * 1e-6));
  }
  return std::monostate{};
}

void Supervisor::drain() {
  while (const std::optional<ipc::PoseRecord> record = pipeline_->poses().try_pop()) {
    latency_.record(*record);
    budget_.record(*record);
    if (output_) output_->add(*record);
    ++poses_;
    ++states_[static_cast<std::size_t>(record->state) % states_.size()];
    last_pose_ns_ = monotonic_ns();
    silence_reported_ = false;
    if (record->state != reported_state_) {
      spdlog::info("scan {}: {} -> {} ({})", record->sequence, core::name_of(reported_state_),
                   core::name_of(record->state), core::name_of(record->stop_reason));
      reported_state_ = record->state;
    }
    report_clock(*record);
    last_ = record;
  }
  while (const std::optional<ScanDecision> decision = pipeline_->decisions().try_pop()) {
    if (output_) output_->add(*decision);
  }
  while (const std::optional<core::ImuHealth> health = pipeline_->imu_health().try_pop())
    imu_report_.update(*health);
  for (auto slots = pipeline_->clouds().begin_read(); !slots.empty();
       slots = pipeline_->clouds().begin_read()) {
    if (output_) output_->add(slots.front());
    pipeline_->clouds().consume(1);
  }
}

void Supervisor::report_plan(const std::vector<PlanOutcome>& outcomes) {
  // Not of interest in a replay at normal priority.
  const auto good = pipeline_->input().live ? spdlog::level::info : spdlog::level::debug;
  for (const PlanOutcome& outcome : outcomes) {
    spdlog::log(outcome.granted && !outcome.warns ? good : spdlog::level::warn, "{}", outcome.text);
    plan_lines_.push_back(outcome.text);
  }
}

/// Logs the time source at the first scan and at every change.
void Supervisor::report_clock(const ipc::PoseRecord& record) {
  if (last_ && last_->clock_source == record.clock_source && !record.after_time_jump) return;
  if (record.after_time_jump)
    spdlog::warn("scan {}: the LiDAR's clock was set; its timeline is reset", record.sequence);
  spdlog::info("scan {}: LiDAR time source {}", record.sequence, core::name_of(record.clock_source));
}

/// Logs the events of the odometry and identification threads.
void Supervisor::report_feed() {
  while (const std::optional<EventLog::Line> line = pipeline_->event_log().take()) {
    const auto level = line->level == LogLevel::kError     ? spdlog::level::err
                       : line->level == LogLevel::kWarning ? spdlog::level::warn
                                                           : spdlog::level::info;
    spdlog::log(level, "{}", line->text);
  }
}

void Supervisor::report_mixed_senders() {
  for (const auto& lidar : pipeline_->lidars()) {
    const std::string& section = lidar->channel.section();
    if (!lidar->channel.has_mixed_senders() || !mixed_reported_.insert(section).second) continue;
    spdlog::warn("{}: {}", section, lidar->source.status());
  }
}

void Supervisor::watch_publisher() {
  if (!publisher_) return;
  const std::optional<ipc::PublisherEvent> event = publisher_->poll();
  if (!event) return;
  if (event->kind == ipc::PublisherEvent::Kind::kStarted) {
    spdlog::info("{}", event->message);
  } else {
    spdlog::warn("{}", event->message);
  }
}

void Supervisor::watch_can() {
  if (!can_watch_) return;
  for (const drivers::CanEvent& event : can_watch_->poll(monotonic_ns()))
    spdlog::log(event.problem ? spdlog::level::warn : spdlog::level::info, "{}", event.message);
}

void Supervisor::report_status() {
  const std::int64_t now = monotonic_ns();
  if (now < next_status_ns_) return;
  next_status_ns_ = now + kStatusPeriodNs;
  report_silence(now);
  report_mixed_senders();
  if (!last_ || poses_ == poses_at_last_status_) return;
  const auto p50 =
      static_cast<double>(latency_.histogram(ipc::LatencyStage::kEndToEnd).snapshot().percentile(50.0)) *
      1e-6;
  spdlog::info(
      "{}: {} poses (+{}), position {:.2f} {:.2f} {:.2f} m, {:.2f} m/s, {} correspondences, latency p50 "
      "{:.1f} ms",
      core::name_of(last_->state), poses_, poses_ - poses_at_last_status_, last_->position[0],
      last_->position[1], last_->position[2], last_->linear_velocity[0], last_->correspondences, p50);
  poses_at_last_status_ = poses_;
}

void Supervisor::report_silence(std::int64_t now) {
  if (!pipeline_->input().live || silence_reported_ || now - last_pose_ns_ < kSilenceNs) return;
  spdlog::warn("no scan for {:.0f} s: {}", static_cast<double>(now - last_pose_ns_) * 1e-9,
               pipeline_->input().packets->status());
  silence_reported_ = true;
}

Result<std::monostate> Supervisor::run(const std::atomic<bool>& stop) {
  started_ns_ = last_pose_ns_ = monotonic_ns();
  next_status_ns_ = started_ns_ + kStatusPeriodNs;
  const auto granted = pipeline_->start();
  if (!granted) return granted.error();
  report_plan(*granted);
  while (!pipeline_->finished() && !stop.load()) {
    pipeline_->output_event().wait(kPollPeriod);
    drain();
    report_feed();
    watch_publisher();
    watch_can();
    report_status();
  }
  pipeline_->request_stop();
  pipeline_->join();
  drain();
  report_feed();
  report_mixed_senders();
  if (publisher_) {
    if (const auto event = publisher_->stop(); event && event->unpublished > 0)
      spdlog::warn("{}", event->message);
  }
  report_end();
  if (output_) {
    if (auto finished = output_->finish(summary().dump(2), latency_); !finished) return finished;
  }
  if (poses_ == 0 && options_.replay) return Error{explain_no_poses(*pipeline_)};
  return std::monostate{};
}

nlohmann::json Supervisor::summary() const {
  nlohmann::json json = pipeline_summary(*pipeline_);
  json["stages"] = ipc::latency_json(latency_);
  json["counters"].update({
      {"poses", poses_},
      {"poses_initialising", states_[0]},
      {"poses_tracking", states_[1]},
      {"poses_degraded", states_[2]},
      {"poses_lost", states_[3]},
      {"publisher_restarts", publisher_ ? publisher_->restarts() : 0},
      {"publisher_dropped", publisher_ ? publisher_->ring().dropped() : 0},
      {"publisher_samples", publisher_ ? publisher_->samples().written() : 0},
      {"publisher_samples_dropped", publisher_ ? publisher_->samples().dropped() : 0},
  });
  if (can_watch_) json["counters"].update(nlohmann::json(can_watch_->counters()));
  json["imu"] = imu_report_.json();
  json["budget"] = budget_.json(pipeline_->budget());
  json["budget"]["superseded"] = pipeline_->counters().superseded.load();
  json["threads"] = plan_lines_;
  const MemoryUse memory = memory_use();
  json["memory"] = {{"resident_bytes", memory.resident_bytes},
                    {"peak_resident_bytes", memory.peak_resident_bytes},
                    {"locked_bytes", memory.locked_bytes}};
  if (last_) json["clock_source"] = core::name_of(last_->clock_source);
  if (output_) json["path_length_m"] = output_->path_length_m();
  return json;
}

void Supervisor::report_unused_imu() const {
  if (imu_report_.is_compared()) {
    spdlog::info(
        "IMU: compared with the LiDAR, but not used; it has not yet predicted a turn better than a constant "
        "rate");
    return;
  }
  spdlog::warn(
      "IMU: no scan covered ({} samples decoded) - check imu.preset and that both logs are "
      "of "
      "the same time",
      pipeline_->counters().imu_samples.load());
}

void Supervisor::report_end() const {
  const OdometryCounters& counters = pipeline_->counters();
  const double seconds = static_cast<double>(monotonic_ns() - started_ns_) * 1e-9;
  spdlog::info("{} scans, {} poses ({} initialising, {} tracking, {} degraded, {} lost) in {:.1f} s",
               counters.scans.load(), poses_, states_[0], states_[1], states_[2], states_[3], seconds);
  if (output_) spdlog::info("path {:.2f} m; outputs in {}", output_->path_length_m(), options_.output_folder);
  const drivers::ScanAssemblerStats scans = pipeline_->scan_stats();
  if (scans.lost_packets + scans.partial_scans + pipeline_->packets_dropped() > 0) {
    spdlog::info("{} packets lost in the network, {} dropped by niliod, {} partial scans discarded",
                 scans.lost_packets, pipeline_->packets_dropped(), scans.partial_scans);
  }
  log_merged_lidars(*pipeline_);
  const Input& input = pipeline_->input();
  if (input.packets && input.packets->stats().malformed > 0) spdlog::warn("{}", input.packets->status());
  if (input.frames) {
    if (input.frames->stats().malformed > 0) spdlog::warn("{}", input.frames->status());
    if (counters.scans_with_imu.load() == 0) report_unused_imu();
  }
  if (const std::string text = budget_.text(pipeline_->budget()); !text.empty()) spdlog::info("{}", text);
  if (const std::uint64_t missed = counters.decisions_missed.load(); missed > 0)
    spdlog::warn(
        "{} scans do not match the decision log: it belongs to another recording, or to one "
        "with other lost packets; this run does not repeat it",
        missed);
  const MemoryUse memory = memory_use();
  spdlog::info("memory: {} MiB resident, {} MiB peak, {} MiB locked", memory.resident_bytes >> 20U,
               memory.peak_resident_bytes >> 20U, memory.locked_bytes >> 20U);
  spdlog::info("latency by stage:\n{}", ipc::latency_table(latency_));
}

}  // namespace

Result<std::monostate> supervise(const Config& config, const RunOptions& options,
                                 const std::atomic<bool>& stop) {
  Supervisor supervisor(config, options);
  if (auto opened = supervisor.open(); !opened) return opened;
  return supervisor.run(stop);
}

}  // namespace nilio::daemon
