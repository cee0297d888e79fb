#include "daemon/supervision/supervisor.hpp"

#include "nilio/core/units.hpp"

#include "daemon/config/convert.hpp"
#include "daemon/config/schema.hpp"
#include "daemon/odometry/decision_log.hpp"
#include "daemon/odometry/pipeline.hpp"
#include "daemon/output/file_writer.hpp"
#include "daemon/output/run_log.hpp"
#include "daemon/realtime/thread_plan.hpp"
#include "daemon/realtime/watchdog.hpp"
#include "daemon/service/service_report.hpp"
#include "daemon/supervision/publisher_starts.hpp"
#include "ipc/mapper_process.hpp"
#include "ipc/publisher_process.hpp"

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <sys/resource.h>
#include <utility>

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
constexpr std::int64_t kSilenceReportPeriodNs = 60'000'000'000;
// A LiDAR takes half a minute from power to packets; a longer silence needs somebody.
constexpr std::int64_t kSilenceErrorNs = 60'000'000'000;
constexpr std::size_t kPublisherSlots = 1024;
// SIGTERM ends the process within 2 s, of which the publisher may take half.
constexpr Duration kPublisherPatience = Duration::from_seconds(0.8);
// In parallel with the publisher.
constexpr Duration kMapperPatience = Duration::from_seconds(1.0);
constexpr Duration kDiskPatience = Duration::from_seconds(0.8);
// The end of a replay is not in a hurry.
constexpr Duration kReplayPublisherPatience = Duration::from_seconds(2.0);
constexpr Duration kReplayDiskPatience = Duration::from_seconds(60.0);
// Of the SIGTERM's 2 s.
constexpr Duration kTrajectoryPatience = Duration::from_seconds(0.2);
constexpr Duration kReplayTrajectoryPatience = Duration::from_seconds(20.0);
// map.ply gets what is left of it.
constexpr Duration kStopPatience = Duration::from_seconds(1.5);
constexpr Duration kReplayExportPatience = Duration::from_seconds(60.0);
// Beside publisher and disk: threads that end, and a reserve.
constexpr Duration kStopReserve = Duration::from_seconds(5.0);
constexpr std::int64_t kServicePeriodNs = 100'000'000;
constexpr const char* kPublisherName = "nilio-publisher";

spdlog::level::level_enum level_of(LogLevel level) {
  return level == LogLevel::kError     ? spdlog::level::err
         : level == LogLevel::kWarning ? spdlog::level::warn
                                       : spdlog::level::info;
}

/// Starts, watches and ends the parts of one run. Never waits for a disk: files belong to the FileWriter.
class Supervisor {
 public:
  Supervisor(const Config& config, const RunOptions& options, const ServiceNotifier& service)
      : config_(config),
        options_(options),
        log_(!options.rules.are_live() && !options.rules.is_paced()),
        service_(service, monotonic_ns()) {}

  Result<std::monostate> open();
  Result<RunResult> run(RunRequests& requests);

 private:
  Result<std::monostate> open_publisher();
  Result<std::monostate> open_mapper();
  Result<std::monostate> open_pipeline(Input input);
  Result<std::monostate> open_files(const std::optional<core::SE3>& T_camera_lidar);
  void take_results();
  void watch_threads();
  void watch();
  void watch_publisher();
  void log_mapper(const ipc::ProcessEvent& event);
  void hasten() const;
  void stop_mapper(Duration timeout);
  void correct_trajectory(Duration timeout);
  void export_map(Duration timeout);
  void watch_can();
  void watch_files();
  void report_status();
  void report_silence(std::int64_t now);
  void report_events();
  void log(const std::optional<EventLog::Line>& line);
  [[nodiscard]] RunResult replay_result(bool stopped) const;
  Result<std::monostate> finish_files(bool stopped, const RunResult& result);
  Result<nlohmann::json> result_json(const RunResult& result) const;
  void reload(std::atomic<bool>& requested);
  void report_to_service();
  [[nodiscard]] nlohmann::json summary() const;

  /// As the run uses it: a reload changes the keys that may change.
  Config config_;
  const RunOptions& options_;
  /// Until the pipeline runs.
  std::optional<StartupPriority> startup_;
  std::unique_ptr<ipc::PublisherProcess> publisher_;
  std::unique_ptr<ipc::MapperProcess> mapper_;
  std::shared_ptr<Pipeline> pipeline_;
  std::unique_ptr<CanWatch> can_watch_;
  std::unique_ptr<FileWriter> files_;
  RunLog log_;
  PublisherStarts publisher_starts_;
  bool mapper_failed_ = false;
  Watchdog watchdog_;
  ServiceReport service_;
  ConfigReader config_reader_;
  /// The bus's last event if it is a problem, else empty.
  std::string can_problem_;
  std::size_t refused_requests_ = 0;
  std::int64_t next_service_ns_ = 0;
  std::int64_t started_ns_ = 0;
  std::int64_t next_status_ns_ = 0;
  std::int64_t last_pose_ns_ = 0;
  /// Time of the next report of silence; 0 = two seconds after the last pose.
  std::int64_t next_silence_report_ns_ = 0;
};

Result<std::monostate> Supervisor::open_publisher() {
  if (!config_.publisher.enabled) return std::monostate{};
  ipc::PublisherProcessConfig config;
  config.executable = options_.publisher_executable;
  config.domain = static_cast<std::uint32_t>(config_.publisher.domain);
  config.interface_whitelist = config_.publisher.interfaces;
  config.odom_frame = config_.publisher.odom_frame;
  config.base_frame = config_.publisher.base_frame;
  config.topic_prefix = config_.publisher.topic_prefix;
  config.transform = config_.publisher.transform;
  config.scan_points = static_cast<std::size_t>(config_.publisher.scan_points);
  config.scan_rate_max_hz = config_.publisher.scan_rate_max_hz;
  config.path_poses = static_cast<std::size_t>(config_.publisher.path_poses);
  config.ring_capacity = kPublisherSlots;
  if (config_.imu.enabled && config_.publisher.imu_rate) config.imu_poses = imu_pose_config(config_);
  const Result<ThreadPlan> plan = make_thread_plan(config_, options_.rules);
  if (!plan) return plan.error();
  if (plan->fifo) {
    config.priority = config_.realtime.publisher_priority;
    config.imu_pose_priority = config_.realtime.imu_pose_priority;
  }
  config.lock_memory = plan->lock_memory;
  config.wait_for_subscribers = Duration::from_seconds(config_.publisher.wait_for_subscribers_s);
  auto publisher = ipc::PublisherProcess::create(std::move(config));
  if (!publisher) return publisher.error();
  publisher_ = std::move(publisher).value();
  const Result<pid_t> pid = publisher_->start();
  if (pid) {
    spdlog::info("nilio-publisher started, pid {}, DDS domain {}", *pid, config_.publisher.domain);
  } else {
    ipc::PublisherEvent failed;
    failed.kind = ipc::PublisherEvent::Kind::kStartFailed;
    failed.message = pid.error().message;
    log(publisher_starts_.observe(failed, 0));
  }
  return std::monostate{};
}

Result<std::monostate> Supervisor::open_mapper() {
  const bool writes_map = !options_.output_folder.empty() && config_.output.map;
  const bool continues_run = config_.mapper.localise_in.empty() && writes_map && !options_.killed_run.empty();
  const std::filesystem::path saved_map =
      continues_run ? options_.killed_run + "/map" : config_.mapper.localise_in;
  if (!writes_map && saved_map.empty()) return std::monostate{};
  ipc::MapperProcessConfig config;
  const std::filesystem::path output = std::filesystem::absolute(options_.output_folder);
  if (writes_map) config.folder = output / "map";
  if (!saved_map.empty()) {
    config.saved_map = std::filesystem::absolute(saved_map);
    config.continues_run = continues_run;
    config.keeps_all = !options_.rules.are_live() && !options_.rules.is_paced();
    if (!options_.output_folder.empty()) {
      config.localisation_file = output / "localisation.txt";
      std::error_code ignored;
      std::filesystem::remove(config.localisation_file, ignored);
    }
  }
  config.executable = options_.mapper_executable;
  config.range_m = config_.mapper.range_m;
  config.max_voxels = config_.mapper.max_voxels;
  config.kept_submaps = config_.mapper.kept_submaps;
  config.closes_loops = config_.mapper.loops;
  config.returns_submaps = config_.output.mcap;
  config.publish = config_.publisher.enabled;
  config.domain = static_cast<std::uint32_t>(config_.publisher.domain);
  config.interface_whitelist = config_.publisher.interfaces;
  config.odom_frame = config_.publisher.odom_frame;
  config.topic_prefix = config_.publisher.topic_prefix;
  auto mapper = ipc::MapperProcess::create(std::move(config));
  if (!mapper) return mapper.error();
  mapper_ = std::move(mapper).value();
  const Result<pid_t> pid = mapper_->start();
  if (continues_run)
    spdlog::info("{}: was killed; its map is continued if the vehicle finds itself there",
                 options_.killed_run);
  if (pid) {
    spdlog::info("nilio-mapper started, pid {}{}{}", *pid, writes_map ? ", map in " : "",
                 mapper_->folder().string());
  } else {
    spdlog::error(
        "{}; poses continue without a map - install nilio-mapper beside niliod, or set output.map to false",
        pid.error().message);
    mapper_.reset();
  }
  return std::monostate{};
}

Result<std::monostate> Supervisor::open_pipeline(Input input) {
  PipelineOptions pipeline_options;
  pipeline_options.rules = options_.rules;
  pipeline_options.thread_hook = options_.thread_hook;
  if (!options_.decisions_file.empty()) {
    auto decisions = read_decisions(options_.decisions_file);
    if (!decisions) return decisions.error();
    if (decisions->empty()) return Error{options_.decisions_file + ": contains no decision"};
    pipeline_options.decisions = std::move(decisions).value();
  }
  pipeline_options.collect_clouds = !options_.output_folder.empty() && config_.output.mcap;
  pipeline_options.mapper = mapper_.get();
  pipeline_options.record = !options_.record_folder.empty();
  auto pipeline = Pipeline::create(config_, std::move(input), pipeline_options, publisher_.get());
  if (!pipeline) return pipeline.error();
  pipeline_ = std::move(pipeline).value();
  return std::monostate{};
}

Result<std::monostate> Supervisor::open_files(const std::optional<core::SE3>& T_camera_lidar) {
  const auto report = [](const std::string& line) { spdlog::warn("{}", line); };
  DecisionHeader header{pipeline_->budget().mode, pipeline_->budget().budget, {}};
  std::unique_ptr<RunRecorder> recorder;
  if (!options_.record_folder.empty()) {
    auto created = RunRecorder::create(options_.record_folder, to_yaml(config_), report);
    if (!created) return created.error();
    recorder = std::move(created).value();
    if (options_.rules.are_live()) recorder->open_decisions(decision_line(header));
    header.recording = {std::filesystem::absolute(options_.record_folder).string()};
  } else {
    for (const std::string& path : options_.recording)
      header.recording.push_back(std::filesystem::absolute(path).string());
  }
  std::unique_ptr<RunOutput> output;
  if (!options_.output_folder.empty()) {
    RunOutput::Options output_options;
    output_options.folder = options_.output_folder;
    output_options.T_camera_lidar = T_camera_lidar;
    output_options.T_base_lidar = odometry_config(config_).T_base_lidar;
    output_options.mcap = config_.output.mcap;
    if (mapper_) output_options.submaps = mapper_->submaps();
    output_options.frames = {config_.publisher.odom_frame, config_.publisher.base_frame};
    auto created = RunOutput::create(output_options, to_yaml(config_), report);
    if (!created) return created.error();
    output = std::move(created).value();
    if (options_.rules.are_live()) output->open_decisions(decision_line(header));
  }
  if (output || recorder)
    files_ = std::make_unique<FileWriter>(pipeline_, std::move(output), std::move(recorder));
  return std::monostate{};
}

Result<std::monostate> Supervisor::open() {
  const Result<ThreadPlan> plan = make_thread_plan(config_, options_.rules);
  if (plan && plan->fifo) startup_.emplace();
  Result<Input> input =
      options_.rules.has_sensors() ? open_live(config_) : open_replay(options_.files, config_);
  if (!input) return input.error();
  for (const std::string& note : input->notes) spdlog::info("{}", note);
  for (const std::string& warning : input->warnings) spdlog::warn("{}", warning);
  apply_extrinsics(*input, config_);
  if (auto opened = open_publisher(); !opened) return opened;
  if (auto opened = open_mapper(); !opened) return opened;
  can_watch_ = std::move(input->can_watch);
  const std::optional<core::SE3> T_camera_lidar = input->T_camera_lidar;
  if (auto opened = open_pipeline(std::move(input).value()); !opened) return opened;
  return open_files(T_camera_lidar);
}

/// Passes results on to log and files. In a replay, poses wait while the files have no room for them.
void Supervisor::take_results() {
  const auto has_room = [&] { return options_.rules.are_live() || !files_ || files_->has_room(); };
  while (has_room()) {
    const std::optional<ipc::PoseRecord> record = pipeline_->poses().try_pop();
    if (!record) break;
    log_.add(*record);
    service_.add(*record);
    if (files_) files_->add(*record);
    last_pose_ns_ = monotonic_ns();
    next_silence_report_ns_ = 0;
  }
  while (const std::optional<core::ImuHealth> health = pipeline_->imu_health().try_pop()) log_.add(*health);
}

void Supervisor::log(const std::optional<EventLog::Line>& line) {
  if (line) spdlog::log(level_of(line->level), "{}", line->text);
}

/// Logs the events of the odometry thread.
void Supervisor::report_events() {
  while (const std::optional<EventLog::Line> line = pipeline_->event_log().take()) log(line);
}

void Supervisor::watch_publisher() {
  if (!publisher_) return;
  const std::uint64_t heartbeat = publisher_->state().heartbeat();
  log(publisher_starts_.observe(heartbeat));
  if (const auto event = publisher_->poll()) log(publisher_starts_.observe(*event, heartbeat));
}

/// A mapper that ends again and again is one error.
void Supervisor::log_mapper(const ipc::ProcessEvent& event) {
  using Kind = ipc::ProcessEvent::Kind;
  if (event.kind == Kind::kStopped && event.exit_status == 0) return;
  if (event.kind == Kind::kStarted) {
    if (!mapper_failed_) spdlog::info("{}", event.message);
    return;
  }
  const bool is_error = event.exit_status > 0 || event.kind == Kind::kStartFailed;
  if (!is_error)
    spdlog::warn("{}", event.message);
  else if (!std::exchange(mapper_failed_, true))
    spdlog::error("{}; poses continue without a map - check the lines of nilio-mapper above", event.message);
}

/// A signal leaves 2 s, even beside threads that take the whole CPU.
void Supervisor::hasten() const {
  setpriority(PRIO_PROCESS, 0, ipc::kHastyNice);
  if (mapper_) mapper_->hasten();
  if (publisher_) publisher_->hasten();
}

void Supervisor::stop_mapper(Duration timeout) {
  const std::vector<ipc::ProcessEvent> events = mapper_->stop(timeout);
  for (const ipc::ProcessEvent& event : events) log_mapper(event);
  if (mapper_->folder().empty()) return;
  if (events.empty() || events.back().exit_status < 0)
    spdlog::warn(
        "{}: the map lacks its end, whose keyframes are in its folder open - complete it with nilio map "
        "recover",
        mapper_->folder().string());
}

void Supervisor::correct_trajectory(Duration timeout) {
  if (!mapper_ || options_.output_folder.empty()) return;
  const std::filesystem::path trajectory = std::filesystem::path(options_.output_folder) / "trajectory.tum";
  const auto report = [](const Result<std::monostate>& done) {
    if (!done) spdlog::warn("{}", done.error().message);
  };
  if (config_.mapper.loops && config_.output.map) report(mapper_->correct_trajectory(trajectory, timeout));
  if (mapper_->state().localised_keyframes.load() > 0)
    report(mapper_->localise_trajectory(trajectory, timeout));
}

void Supervisor::export_map(Duration timeout) {
  if (!mapper_ || mapper_->folder().empty() || mapper_->state().submaps.load() == 0) return;
  const auto done = mapper_->export_map(mapper_->folder().parent_path() / "map.ply", timeout);
  if (!done) spdlog::warn("{}", done.error().message);
}

void Supervisor::watch_can() {
  if (!can_watch_) return;
  for (const drivers::CanEvent& event : can_watch_->poll(monotonic_ns())) {
    spdlog::log(event.problem ? spdlog::level::warn : spdlog::level::info, "{}", event.message);
    can_problem_ = event.problem ? event.message : "";
  }
  if (const auto line = can_watch_->recognise(monotonic_ns()))
    spdlog::log(level_of(line->level), "{}", line->text);
}

void Supervisor::watch_files() {
  if (!files_) return;
  if (const std::optional<std::string> line = files_->poll(monotonic_ns())) spdlog::warn("{}", *line);
}

void Supervisor::watch_threads() {
  for (const RealtimeThread& thread : pipeline_->threads())
    watchdog_.watch(name_of(thread.role()), [&thread] { return thread.heartbeat(); });
  // Packets that wait and are not taken; the additional LiDARs' wait for the first one's scans.
  if (!pipeline_->lidars().empty())
    watchdog_.watch("processing of LiDAR packets", [&lidar = *pipeline_->lidars().front()] {
      const bool waits = lidar.ring.size() > 0;
      return waits ? std::optional(lidar.channel.packets_taken()) : std::nullopt;
    });
  if (!publisher_) return;
  // DDS takes seconds to start: a process is watched from its first beat on.
  watchdog_.watch(kPublisherName, [this, pid = pid_t{-1}, first = std::uint64_t{0}]() mutable {
    const std::uint64_t beats = publisher_->state().heartbeat();
    if (std::exchange(pid, publisher_->pid()) != publisher_->pid()) first = beats;
    const bool runs = publisher_->running() && beats != first;
    return runs ? std::optional(beats) : std::nullopt;
  });
}

void Supervisor::watch() {
  for (const Watchdog::Event& event : watchdog_.poll(monotonic_ns()))
    spdlog::log(event.hangs ? spdlog::level::err : spdlog::level::warn, "{}", event.text);
  watch_publisher();
  if (mapper_) {
    if (const auto event = mapper_->poll()) log_mapper(*event);
  }
  watch_can();
  watch_files();
}

void Supervisor::report_status() {
  const std::int64_t now = monotonic_ns();
  if (now < next_status_ns_) return;
  next_status_ns_ = now + kStatusPeriodNs;
  report_silence(now);
  log_.report_status();
}

void Supervisor::report_silence(std::int64_t now) {
  const std::int64_t due = std::max(last_pose_ns_ + kSilenceNs, next_silence_report_ns_);
  if (!options_.rules.has_sensors() || now < due) return;
  const std::int64_t silence_ns = now - last_pose_ns_;
  spdlog::log(silence_ns >= kSilenceErrorNs ? spdlog::level::err : spdlog::level::warn,
              "no scan for {:.0f} s: {}", static_cast<double>(silence_ns) * 1e-9,
              pipeline_->input().packets->status());
  next_silence_report_ns_ = now + kSilenceReportPeriodNs;
}

/// Reads the configuration when `requested`, and takes over what may change once it is read.
void Supervisor::reload(std::atomic<bool>& requested) {
  if (!config_reader_.is_reading() && requested.exchange(false)) {
    service_.begin_reload(monotonic_ns());
    config_reader_.start(options_.load_config);
  }
  const std::optional<Result<Config>> loaded = config_reader_.take();
  if (!loaded) return;
  const ReloadReport report = reload_config(config_, *loaded);
  // Whoever asked for it wants the outcome, at any level.
  spdlog::set_level(spdlog::level::info);
  for (const std::string& line : report.lines)
    spdlog::log(report.refused ? spdlog::level::err : spdlog::level::info, "{}", line);
  spdlog::set_level(spdlog::level::from_str(config_.log.level));
  service_.end_reload(report.problem());
}

void Supervisor::report_to_service() {
  const std::int64_t now = monotonic_ns();
  if (now < next_service_ns_) return;
  next_service_ns_ = now + kServicePeriodNs;
  ServiceHealth health;
  const bool publishes = publisher_ && publisher_->state().heartbeat() > 0;
  health.is_ready = !config_.publisher.enabled || publishes;
  const std::vector<std::string> hanging = watchdog_.hanging();
  for (const std::string& name : hanging) health.problems.push_back(name + " hangs");
  // niliod itself restarts a publisher that hangs; a restart of both would lose the map.
  const bool threads_run =
      std::ranges::all_of(hanging, [](const std::string& name) { return name == kPublisherName; });
  const bool is_silent = options_.rules.has_sensors() && now - last_pose_ns_ >= kSilenceNs;
  health.makes_progress = threads_run && (!is_silent || next_silence_report_ns_ != 0);
  if (publisher_ && !publisher_->running()) health.problems.emplace_back("nilio-publisher does not run");
  if (is_silent)
    health.problems.push_back("no scan for " + std::to_string((now - last_pose_ns_) / kNanosecondsPerSecond) +
                              " s: " + pipeline_->input().packets->status());
  if (!can_problem_.empty()) health.problems.push_back(can_problem_);
  if (files_ && files_->is_slow()) health.problems.emplace_back("the disk takes no data");
  if (refused_requests_ > 0)
    health.problems.push_back(std::to_string(refused_requests_) + " real-time requests refused, see the log");
  service_.update(now, health);
}

Result<RunResult> Supervisor::run(RunRequests& requests) {
  const std::atomic<bool>& stop = requests.stop;
  started_ns_ = last_pose_ns_ = monotonic_ns();
  next_status_ns_ = started_ns_ + kStatusPeriodNs;
  const auto granted = pipeline_->start();
  startup_.reset();
  if (!granted) return granted.error();
  log_.add(*granted, options_.rules.has_sensors());
  refused_requests_ = static_cast<std::size_t>(
      std::ranges::count_if(*granted, [](const PlanOutcome& outcome) { return !outcome.granted; }));
  if (options_.rules.are_live()) watch_threads();
  while (!pipeline_->finished() && !stop.load()) {
    pipeline_->output_event().wait(kPollPeriod);
    take_results();
    report_events();
    watch();
    report_status();
    reload(requests.reload);
    report_to_service();
  }
  const bool stopped = stop.load();
  const std::int64_t stopped_ns = monotonic_ns();
  if (stopped) hasten();
  service_.stop(
      (stopped ? kPublisherPatience + kDiskPatience : kReplayPublisherPatience + kReplayDiskPatience) +
      kStopReserve);
  pipeline_->request_stop();
  pipeline_->join();
  take_results();
  // A stopped run does not wait for a disk.
  while (!stopped && !stop.load() && pipeline_->poses().size() > 0) {
    pipeline_->output_event().wait(kPollPeriod);
    take_results();
  }
  report_events();
  // The mapper completes the map while the publisher writes the last poses.
  const Duration mapper_patience = stopped ? kMapperPatience : kReplayDiskPatience;
  const std::int64_t mapper_deadline_ns = monotonic_ns() + mapper_patience.ns;
  if (mapper_) mapper_->request_stop(mapper_patience);
  if (publisher_) {
    const auto event = publisher_->stop(stopped ? kPublisherPatience : kReplayPublisherPatience);
    if (event) log(publisher_starts_.observe(*event, publisher_->state().heartbeat()));
    log(publisher_starts_.observe(publisher_->state().heartbeat()));
  }
  if (mapper_) stop_mapper({std::max<std::int64_t>(mapper_deadline_ns - monotonic_ns(), 0)});
  log_.report_end(*pipeline_, static_cast<double>(monotonic_ns() - started_ns_) * 1e-9);
  const RunResult result = options_.rules.has_sensors() ? RunResult{} : replay_result(stopped);
  if (auto finished = finish_files(stopped, result); !finished) return finished.error();
  correct_trajectory(stopped ? kTrajectoryPatience : kReplayTrajectoryPatience);
  const Duration left{stopped_ns + kStopPatience.ns - monotonic_ns()};
  export_map(stopped ? std::max(left, Duration{0}) : kReplayExportPatience);
  return result;
}

RunResult Supervisor::replay_result(bool stopped) const {
  const RunTotals& totals = log_.totals();
  if (stopped)
    return {kFailed, "stopped by a signal before the end of the recording: the outputs hold " +
                         std::to_string(totals.poses()) + " poses, and no result.json is written"};
  if (totals.poses() == 0) return {kFailed, explain_no_poses(*pipeline_)};
  RunResult result = totals.verdict();
  if (result.exit_status == kDone && !publisher_starts_.failure().empty())
    result = {kBadResult, "nothing was published over DDS: " + publisher_starts_.failure()};
  return result;
}

/// Content of result.json.
Result<nlohmann::json> Supervisor::result_json(const RunResult& result) const {
  nlohmann::json json = log_.totals().json();
  Result<nlohmann::json> inputs = describe_inputs(options_.files, config_, options_.decisions_file);
  if (!inputs) return inputs.error();
  json["inputs"] = *inputs;
  json["scans"] = pipeline_->counters().scans.load();
  json["scans_with_imu"] = pipeline_->counters().scans_with_imu.load();
  json["wall_s"] = static_cast<double>(monotonic_ns() - started_ns_) * 1e-9;
  json["exit_status"] = static_cast<int>(result.exit_status);
  json["problem"] = result.problem;
  json.update(describe_process(config_));
  return json;
}

Result<std::monostate> Supervisor::finish_files(bool stopped, const RunResult& result) {
  if (!files_) return std::monostate{};
  RunOutput::FinalFiles final_files = log_.latency_files();
  final_files["latency.json"] = summary().dump(2) + '\n';
  const bool has_result = !options_.rules.has_sensors() && result.exit_status != kFailed;
  if (has_result && !options_.output_folder.empty()) {
    const Result<nlohmann::json> json = result_json(result);
    if (!json) return json.error();
    final_files["result.json"] = json->dump(2) + '\n';
  }
  auto finished = files_->finish(std::move(final_files), stopped ? kDiskPatience : kReplayDiskPatience);
  if (finished && !options_.output_folder.empty())
    spdlog::info("path {:.2f} m; outputs in {}", log_.totals().path_length_m(), options_.output_folder);
  return finished;
}

nlohmann::json Supervisor::summary() const {
  nlohmann::json json = log_.summary(*pipeline_);
  json["counters"].update({
      {"publisher_restarts", publisher_ ? publisher_->restarts() : 0},
      {"publisher_dropped", publisher_ ? publisher_->ring().dropped() : 0},
      {"publisher_samples", publisher_ ? publisher_->samples().written() : 0},
      {"publisher_samples_dropped", publisher_ ? publisher_->samples().dropped() : 0},
      {"publisher_scans", publisher_ ? publisher_->scans().written() : 0},
      {"publisher_scans_dropped", publisher_ ? publisher_->scans().dropped() : 0},
      {"mapper_restarts", mapper_ ? mapper_->restarts() : 0},
      {"mapper_keyframes", mapper_ ? mapper_->keyframes().written() : 0},
      {"mapper_keyframes_dropped", mapper_ ? mapper_->keyframes().dropped() : 0},
      {"mapper_submaps", mapper_ ? mapper_->state().submaps.load() : 0},
      {"mapper_loops", mapper_ ? mapper_->state().loops.load() : 0},
      {"mapper_localised_keyframes", mapper_ ? mapper_->state().localised_keyframes.load() : 0},
      {"mapper_localisation_dropped", mapper_ ? mapper_->state().localisation_dropped.load() : 0},
      {"mapper_bytes", mapper_ ? mapper_->state().map_bytes.load() : 0},
      {"mapper_failed_writes", mapper_ ? mapper_->state().failed_writes.load() : 0},
      {"watchdog_hangs", watchdog_.hangs()},
  });
  if (mapper_) json["localisation"] = ipc::name_of(mapper_->state().localisation.load());
  if (can_watch_) json["counters"].update(nlohmann::json(can_watch_->counters()));
  if (publisher_) {
    json["published"] = ipc::publisher_json(publisher_->state());
    // A pose is late if DDS has written it late.
    if (pipeline_->budget().mode == core::BudgetMode::kWall)
      json["budget"]["late_poses"] = publisher_->state().late_poses();
  }
  const FileWriter::Counters files = files_->counters();
  json["counters"].update({
      {"files_poses_dropped", files.poses_dropped},
      {"files_decisions_dropped", files.decisions_dropped},
      {"files_clouds_dropped", files.clouds_dropped},
      {"files_packets_dropped", files.packets_dropped},
      {"files_frames_dropped", files.frames_dropped},
      {"files_disk_lost", files.disk_lost},
  });
  return json;
}

}  // namespace

Result<RunResult> supervise(const Config& config, const RunOptions& options, RunRequests& requests,
                            const ServiceNotifier& service) {
  Supervisor supervisor(config, options, service);
  if (auto opened = supervisor.open(); !opened) return opened.error();
  return supervisor.run(requests);
}

}  // namespace nilio::daemon
