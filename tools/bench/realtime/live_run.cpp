#include "tools/bench/realtime/live_run.hpp"

#include "nilio/core/clock.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include "daemon/exit_status.hpp"
#include "tools/bench/common/niliod_run.hpp"
#include "tools/bench/common/pose_listener.hpp"
#include "tools/bench/realtime/foreign_sender.hpp"
#include "tools/bench/realtime/stress_load.hpp"
#include "tools/bench/realtime/wakeup_latency.hpp"
#include "tools/common/child_process.hpp"
#include "tools/common/files.hpp"
#include "tools/common/system.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <csignal>
#include <fstream>
#include <memory>
#include <sys/prctl.h>
#include <system_error>
#include <thread>
#include <utility>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Duration;
using core::Error;
using core::Result;

/// Above everything else: a load on this computer does not delay a real sensor.
constexpr int kSenderPriority = 90;
constexpr Duration kConnectLimit = Duration::from_seconds(20.0);
constexpr Duration kQuiet = Duration::from_seconds(1.0);
constexpr Duration kBacklogLimit = Duration::from_seconds(20.0);
constexpr Duration kPatience = Duration::from_seconds(10.0);
/// Time to start and end, added to the length of the drive.
constexpr Duration kReplayMargin = Duration::from_seconds(60.0);
constexpr std::array<const char*, kConditions> kConditionNames{
    "idle", "cpu", "memory", "subscriber", "nice", "nice-later", "foreign", "slow-disk", "full-disk"};
constexpr const char* kDiskLibrary = "libnilio-slow-disk.so";
constexpr const char* kSlowWriteMs = "1000";

const Error kInterrupted{"interrupted"};

/// While the file exists, the disk of the output folder is full: in the second third of a run.
class FullDisk {
 public:
  FullDisk(fs::path file, Duration run)
      : file_(std::move(file)), third_{run.ns / 3}, thread_([this] { fill(); }) {}
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;
  ~FullDisk() {
    stop_.store(true);
    thread_.join();
    std::error_code ignored;
    fs::remove(file_, ignored);
  }

 private:
  void fill() {
    pause();
    std::ofstream(file_) << "full\n";
    pause();
    std::error_code ignored;
    fs::remove(file_, ignored);
  }
  void pause() {
    const std::int64_t until = monotonic_ns() + third_.ns;
    while (!stop_.load() && monotonic_ns() < until) sleep_for(kPoll);
  }

  fs::path file_;
  Duration third_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// One run, from the start of the first program to the end of the last.
class RunInRealTime {
 public:
  RunInRealTime(const SensorDrive& drive, const DrivePart& part, const RealtimeRunConfig& config,
                const fs::path& folder, StopSignals& signals)
      : drive_(drive), part_(part), config_(config), folder_(folder), signals_(signals) {}

  Result<RealtimeRun> run();

 private:
  Result<std::monostate> start_load();
  void start_reader();
  [[nodiscard]] std::vector<std::string> environment() const;
  [[nodiscard]] bool has_bad_disk() const {
    return config_.condition == Condition::kSlowDisk || config_.condition == Condition::kFullDisk;
  }
  [[nodiscard]] fs::path full_disk_file() const { return folder_ / "full"; }
  Result<std::monostate> start_later_load();
  Result<std::monostate> stop_niliod();
  Result<std::monostate> start_program();
  /// Waits until the condition holds; false after `limit`. Fails on a stop signal.
  template <class Condition>
  Result<bool> wait_for(Duration limit, const Condition& condition);
  Result<std::monostate> connect();
  Result<std::monostate> stop_slow_subscriber();
  Result<std::monostate> feed();
  Result<std::monostate> play();
  Result<std::monostate> let_backlog_end();
  void read_report();

  const SensorDrive& drive_;
  const DrivePart& part_;
  const RealtimeRunConfig& config_;
  const fs::path& folder_;
  StopSignals& signals_;
  std::uint16_t port_ = 0;
  std::uint16_t position_port_ = 0;
  std::unique_ptr<PoseListener> listener_;
  std::optional<PoseReader> reader_;
  std::optional<StressLoad> load_;
  std::unique_ptr<ForeignSender> foreign_;
  std::unique_ptr<FullDisk> full_disk_;
  std::optional<ChildProcess> slow_subscriber_;
  std::optional<ChildProcess> niliod_;
  RealtimeRun result_;
};

template <class Condition>
Result<bool> RunInRealTime::wait_for(Duration limit, const Condition& condition) {
  const std::int64_t deadline = monotonic_ns() + limit.ns;
  while (!condition()) {
    if (signals_.wait(kPoll)) return kInterrupted;
    if (monotonic_ns() > deadline) return false;
  }
  return true;
}

Result<std::monostate> RunInRealTime::start_load() {
  std::optional<Result<StressLoad>> load;
  if (config_.condition == Condition::kCpuLoad) load.emplace(StressLoad::cpu_load(kLoadProcesses));
  if (config_.condition == Condition::kUrgentLoad) load.emplace(StressLoad::urgent_cpu_load(kLoadProcesses));
  if (config_.condition == Condition::kMemory)
    load.emplace(StressLoad::memory_pressure(pressure_bytes(config_.memory_bytes)));
  if (load && !*load) return load->error();
  if (load) load_.emplace(std::move(*load).value());
  if (config_.condition != Condition::kSlowSubscriber) return std::monostate{};
  const Result<fs::path> nilio = find_sibling_program("nilio");
  if (!nilio) return nilio.error();
  auto watch = ChildProcess::start(
      *nilio, {"watch", "--domain", std::to_string(config_.domain), "--interface", "127.0.0.1"},
      folder_ / "subscriber.log");
  if (!watch) return watch.error();
  slow_subscriber_.emplace(std::move(watch).value());
  return std::monostate{};
}

/// Begins with the first packet: a load, a full disk, or a second sender.
Result<std::monostate> RunInRealTime::start_later_load() {
  if (config_.condition == Condition::kLaterUrgentLoad) {
    Result<StressLoad> load = StressLoad::urgent_cpu_load(kLoadProcesses);
    if (!load) return load.error();
    load_.emplace(std::move(load).value());
  }
  if (config_.condition == Condition::kFullDisk)
    full_disk_ = std::make_unique<FullDisk>(full_disk_file(), part_.length);
  if (config_.condition != Condition::kForeignSender || config_.feed != Feed::kUdp) return std::monostate{};
  auto source = drivers::open_pcap(part_.files.captures.front(),
                                   {.data_port = static_cast<std::uint16_t>(drive_.config.lidar.port)});
  if (!source) return source.error();
  std::vector<drivers::Packet> packet(1);
  if ((*source)->read(packet, Duration{}).count == 1)
    foreign_ = std::make_unique<ForeignSender>(packet.front(), port_);
  return std::monostate{};
}

void RunInRealTime::start_reader() {
  Result<PoseReader> reader = PoseReader::start(config_.domain, folder_);
  if (reader) {
    reader_.emplace(std::move(reader).value());
  } else {
    result_.why_no_reader = reader.error().message;
  }
}

/// Environment of niliod: the watch of its threads, and the disk.
std::vector<std::string> RunInRealTime::environment() const {
  std::vector<std::string> variables = watch_environment(folder_);
  if (!has_bad_disk()) return variables;
  const Result<fs::path> library = find_sibling_program(kDiskLibrary);
  if (!library) return variables;
  const std::string preload = "LD_PRELOAD=" + library->string();
  if (variables.empty()) {
    variables.push_back(preload);
  } else {
    variables.front() += " " + library->string();
  }
  variables.push_back("NILIO_DISK_FOLDER=" + folder_.string());
  if (config_.condition == Condition::kSlowDisk) {
    variables.push_back(std::string("NILIO_DISK_WRITE_MS=") + kSlowWriteMs);
  } else {
    variables.push_back("NILIO_DISK_FULL_FILE=" + full_disk_file().string());
  }
  return variables;
}

Result<std::monostate> RunInRealTime::start_program() {
  std::vector<std::string> overrides{"publisher.domain=" + std::to_string(config_.domain),
                                     "publisher.interfaces=[\"127.0.0.1\"]"};
  std::vector<std::string> arguments;
  if (config_.feed == Feed::kReplay) {
    arguments = replay_arguments(part_.files);
    arguments.emplace_back("--as-live");
  } else {
    const Result<std::array<std::uint16_t, 2>> ports = free_udp_ports(config_.port);
    if (!ports) return ports.error();
    port_ = (*ports)[0];
    position_port_ = drive_.config.lidar.position_port == 0 ? std::uint16_t{0} : (*ports)[1];
    if (!part_.files.configuration.empty()) arguments = {"--config", part_.files.configuration};
    overrides.insert(overrides.end(), {"lidar.bind_address=127.0.0.1", "lidar.sender_address=\"\"",
                                       "lidar.multicast_group=\"\"", "lidar.port=" + std::to_string(port_),
                                       "lidar.position_port=" + std::to_string(position_port_)});
    overrides.push_back(config_.can_interface.empty() ? "imu.enabled=false"
                                                      : "imu.interface=" + config_.can_interface);
  }
  overrides.insert(overrides.end(), config_.overrides.begin(), config_.overrides.end());
  Result<ChildProcess> niliod = start_niliod(std::move(arguments), overrides, folder_, environment());
  if (!niliod) return niliod.error();
  niliod_.emplace(std::move(niliod).value());
  return std::monostate{};
}

Result<std::monostate> RunInRealTime::connect() {
  const Result<bool> connected = wait_for(kConnectLimit, [this] {
    return niliod_->poll() || (listener_->is_connected() && (!reader_ || reader_->is_ready()));
  });
  if (!connected) return connected.error();
  if (!*connected && listener_->is_connected())
    result_.notes.emplace_back("the independent reader was not matched with the publisher");
  const std::optional<int> ended = niliod_->poll();
  // A replay may end before the subscriber is matched.
  if (ended && (config_.feed == Feed::kUdp || (*ended != kDone && *ended != kBadResult)))
    return Error{"niliod ended early with status " + std::to_string(*ended) + ": " + niliod_->last_line()};
  if (!listener_->is_connected())
    result_.notes.push_back("no publisher was found on DDS domain " + std::to_string(config_.domain) + ": " +
                            niliod_->last_line());
  return std::monostate{};
}

Result<std::monostate> RunInRealTime::stop_slow_subscriber() {
  if (!slow_subscriber_) return std::monostate{};
  const Result<bool> found = wait_for(kConnectLimit, [this] {
    const std::string log = file_text(folder_ / "subscriber.log").value_or("");
    return log.find(": 1 publisher(s)") != std::string::npos || log.find(" received, ") != std::string::npos;
  });
  if (!found) return found.error();
  if (!*found)
    result_.notes.emplace_back("the slow subscriber was not matched with the publisher and had no effect");
  slow_subscriber_->send_signal(SIGSTOP);
  return std::monostate{};
}

Result<std::monostate> RunInRealTime::play() {
  play::PlayConfig play;
  play.captures = part_.files.captures;
  play.recorded_port = static_cast<std::uint16_t>(drive_.config.lidar.port);
  play.recorded_position_port = static_cast<std::uint16_t>(drive_.config.lidar.position_port);
  play.port = port_;
  play.position_port = position_port_;
  // Sensor time equal to host time, as from a sensor with a correct clock.
  play.restamp = true;
  if (!config_.can_interface.empty()) {
    play.can_logs = part_.files.can_logs;
    play.can_interface = config_.can_interface;
  }
  auto session = play::PlaySession::open(
      play, [this](const std::string& line) { result_.notes.push_back("sender: " + line); });
  if (!session) return session.error();
  std::atomic<bool> stop{false};
  std::atomic<bool> ended{false};
  std::int64_t begin_ns = 0;
  std::thread sender([&] {
    make_this_thread_fifo(kSenderPriority);
    prctl(PR_SET_TIMERSLACK, 1UL);
    // Here: under load this thread may begin long after its creation.
    begin_ns = clock_ns(CLOCK_REALTIME);
    result_.sent = (*session)->run([&stop] { return stop.load(); });
    ended.store(true);
  });
  bool died = false;
  while (!ended.load() && !stop.load()) {
    died = niliod_->poll().has_value();
    if (died || signals_.wait(kPoll)) stop.store(true);
  }
  sender.join();
  if (died) return Error{"niliod ended during the run: " + niliod_->last_line()};
  if (signals_.wait(Duration{})) return kInterrupted;
  result_.stamp_shift = part_.first_stamp - core::Time{begin_ns};
  return std::monostate{};
}

/// Waits for the poses of packets that are still in sockets and rings.
Result<std::monostate> RunInRealTime::let_backlog_end() {
  const std::int64_t sent_ns = monotonic_ns();
  const Result<bool> quiet = wait_for(kBacklogLimit, [&] {
    return monotonic_ns() - std::max(listener_->last_pose_ns(), sent_ns) > kQuiet.ns;
  });
  if (!quiet) return quiet.error();
  if (!*quiet)
    result_.notes.emplace_back("poses still arrived 20 s after the last packet; later ones are not counted");
  return std::monostate{};
}

Result<std::monostate> RunInRealTime::feed() {
  if (auto stopped = stop_slow_subscriber(); !stopped) return stopped;
  if (auto started = start_later_load(); !started) return started;
  if (config_.feed == Feed::kReplay) return await_end(*niliod_, part_.length + kReplayMargin, signals_);
  if (auto played = play(); !played) return played;
  if (auto ended = let_backlog_end(); !ended) return ended;
  return stop_niliod();
}

Result<std::monostate> RunInRealTime::stop_niliod() {
  const std::int64_t begin_ns = monotonic_ns();
  const int status = niliod_->stop(kPatience);
  result_.stop_s = 1e-9 * static_cast<double>(monotonic_ns() - begin_ns);
  if (status == 0) return std::monostate{};
  const Error error{"niliod ended with status " + std::to_string(status) + ": " + niliod_->last_line()};
  if (!has_bad_disk()) return error;
  result_.notes.push_back(error.message);
  return std::monostate{};
}

/// Takes the latencies up to DDS write() from the publisher's report.
void RunInRealTime::read_report() {
  const auto report = listener_->latency_report();
  if (!report) return;
  for (const dds::StageLatency& stage : report->stages) {
    ipc::LatencySummary summary;
    summary.name = stage.name;
    summary.count = stage.count;
    summary.p50_us = stage.p50_us;
    summary.p99_us = stage.p99_us;
    summary.max_us = stage.max_us;
    if (stage.name == "received_to_written") result_.received_to_written = summary;
    if (stage.name == "imu_received_to_written") result_.imu_pose = summary;
  }
}

Result<RealtimeRun> RunInRealTime::run() {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) return Error{folder_.string() + ": cannot be created (" + error.message() + ")"};
  auto listener = PoseListener::start(config_.domain);
  if (!listener) return listener.error();
  listener_ = std::move(listener).value();
  if (auto started = start_load(); !started) return started.error();
  start_reader();
  if (auto started = start_program(); !started) return started.error();
  if (auto connected = connect(); !connected) return connected.error();
  WakeupLatency wakeup;
  const auto fed = feed();
  wakeup.stop();
  if (!fed) return fed.error();
  if (load_ && !load_->is_running()) result_.notes.emplace_back("the load was killed during the run");
  Result<NiliodFigures> figures = read_run_figures(folder_);
  if (!figures && !has_bad_disk()) return figures.error();
  if (figures) {
    result_.figures = std::move(figures).value();
  } else {
    result_.notes.push_back(figures.error().message);
  }
  if (auto watch = read_thread_watch(folder_)) {
    result_.watch = std::move(watch).value();
  } else {
    result_.why_not_watched = watch.error().message;
  }
  result_.wakeup = ipc::summarize("wake-up", wakeup.histogram());
  result_.wakeup_is_fifo = wakeup.is_fifo();
  listener_->stop();
  if (reader_) result_.reader = reader_->stop();
  result_.transport = ipc::summarize("DDS", listener_->transport());
  result_.packet_to_subscriber = ipc::summarize("packet to subscriber", listener_->packet_to_pose());
  read_report();
  return std::move(result_);
}

}  // namespace

const char* condition_name(Condition condition) {
  return kConditionNames[static_cast<std::size_t>(condition)];
}

std::optional<Condition> parse_condition(const std::string& name) {
  const auto found = std::find(kConditionNames.begin(), kConditionNames.end(), name);
  if (found == kConditionNames.end()) return std::nullopt;
  return static_cast<Condition>(found - kConditionNames.begin());
}

std::string why_impossible(Condition condition) {
  if (condition == Condition::kUrgentLoad || condition == Condition::kLaterUrgentLoad) {
    const auto load = StressLoad::urgent_cpu_load(1);
    return load ? "" : load.error().message;
  }
  if (condition != Condition::kSlowDisk && condition != Condition::kFullDisk) return "";
  return find_sibling_program(kDiskLibrary) ? "" : std::string(kDiskLibrary) + " is not beside this program";
}

Result<RealtimeRun> run_niliod_in_real_time(const SensorDrive& drive, const DrivePart& part,
                                            const RealtimeRunConfig& config, const fs::path& folder,
                                            StopSignals& signals) {
  return RunInRealTime(drive, part, config, folder, signals).run();
}

}  // namespace nilio::tools::bench
