#include "tools/bench/bench.hpp"
#include "tools/bench/common/niliod_run.hpp"
#include "tools/bench/common/sensor_drive.hpp"
#include "tools/bench/realtime/identity_checks.hpp"
#include "tools/bench/realtime/live_run.hpp"
#include "tools/bench/realtime/requirements.hpp"
#include "tools/bench/realtime/tables.hpp"
#include "tools/bench/report/results_page.hpp"
#include "tools/bench/soak/soak.hpp"
#include "tools/common/files.hpp"
#include "tools/common/system.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>
#include <variant>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

constexpr std::uint64_t kMebibyte = 1024 * 1024;
constexpr int kPictureWidth = 1200;
constexpr int kPictureHeight = 620;
constexpr const char* kLegend =
    "Two numbers: median / 99 %; three: median / 99 % / maximum; wake-up: 99 % / maximum. Beyond budget: "
    "publication later than the last packet's arrival plus the budget. To publication, to DDS, to "
    "subscriber: "
    "from that arrival until the pose is in the publisher's ring, until DDS write() returns, and until a "
    "subscriber on this computer has it. IMU pose: from the CAN frame until DDS write() returns. Wake-up: "
    "delay "
    "of a thread that sleeps until absolute times, every millisecond, during the run; SCHED_FIFO 80, or "
    "(normal) where that is not permitted. To reader: until a CycloneDDS reader in a process of its own "
    "(SCHED_FIFO 30 where permitted) has the pose. Sender delay: 99 % of the packets were sent with at most "
    "this delay. "
    "Conditions: cpu = two processes that never sleep; memory = a process that repeatedly takes most of the "
    "memory; subscriber = a DDS subscriber that stops reading; nice = two processes at nice -20 that never "
    "sleep, from before niliod's start; nice-later = the same from the first packet on; foreign = 20 valid "
    "packets a second from another address; slow-disk = every write to the output folder takes a second; "
    "full-disk = no space left there in the second third of the run.";

struct CellPlan {
  std::optional<double> budget_ms;
  Condition condition = Condition::kIdle;
  Feed feed = Feed::kUdp;
};

/// True when the drive has an IMU whose frames are not sent.
bool lacks_imu(const SensorDrive& drive, const RealtimeOptions& options) {
  return options.feed == "udp" && options.can_interface.empty() && !drive.files.can_logs.empty();
}

/// Plans every budget on an idle computer, or under all conditions with --full, and all conditions under the
/// configured budget. Where the IMU's frames are not sent, adds idle and cpu from the files, with the IMU.
std::vector<CellPlan> plan_cells(const RealtimeOptions& options, const SensorDrive& drive) {
  std::vector<Condition> conditions;
  for (const std::string& name : options.conditions) conditions.push_back(*parse_condition(name));
  std::vector<CellPlan> plan;
  const Feed feed = options.feed == "udp" ? Feed::kUdp : Feed::kReplay;
  for (const double budget : options.conditions_only ? std::vector<double>{} : options.budgets_ms) {
    if (!options.full) {
      plan.push_back({budget, Condition::kIdle, feed});
      continue;
    }
    for (const Condition condition : conditions) plan.push_back({budget, condition, feed});
  }
  for (const Condition condition : conditions) plan.push_back({std::nullopt, condition, feed});
  if (lacks_imu(drive, options) && !options.conditions_only) {
    for (const Condition condition : {Condition::kIdle, Condition::kCpuLoad})
      plan.push_back({std::nullopt, condition, Feed::kReplay});
  }
  return plan;
}

std::string budget_override(double budget_ms) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "odometry.budget_ms=%g", budget_ms);
  return text.data();
}

/// All measurements of one drive.
class RealtimeBench {
 public:
  RealtimeBench(const SensorDrive& drive, const RealtimeOptions& options, StopSignals& signals,
                ResultsPage& page)
      : drive_(drive), options_(options), signals_(signals), page_(page) {}

  /// False when a requirement failed.
  Result<bool> run();

 private:
  [[nodiscard]] RealtimeRunConfig run_config() const;
  Result<std::monostate> measure_cell(const CellPlan& plan);
  Result<std::monostate> measure_counted(double budget_ms);
  Result<std::monostate> measure_planted();
  Result<std::monostate> measure_reference();
  Result<std::monostate> measure_cells();
  void add_tables();
  Result<std::monostate> add_pictures();
  fs::path next_folder() { return work_->path() / ("run" + std::to_string(runs_++)); }

  const SensorDrive& drive_;
  const RealtimeOptions& options_;
  StopSignals& signals_;
  ResultsPage& page_;
  std::optional<WorkFolder> work_;
  DrivePart part_;
  int runs_ = 0;
  std::vector<RealtimeCell> cells_;
  std::vector<CountedRun> counted_;
  std::optional<ThreadWatch> planted_;
  AccuracyReference reference_;
};

RealtimeRunConfig RealtimeBench::run_config() const {
  RealtimeRunConfig config;
  config.feed = options_.feed == "udp" ? Feed::kUdp : Feed::kReplay;
  config.overrides = options_.overrides;
  config.memory_bytes = options_.memory_mib * kMebibyte;
  config.can_interface = options_.can_interface;
  config.domain = options_.soak.domain;
  config.port = options_.port;
  return config;
}

Result<std::monostate> RealtimeBench::measure_cell(const CellPlan& plan) {
  RealtimeRunConfig config = run_config();
  config.condition = plan.condition;
  config.feed = plan.feed;
  if (plan.budget_ms) config.overrides.push_back(budget_override(*plan.budget_ms));
  const fs::path folder = next_folder();
  Result<RealtimeRun> run = run_niliod_in_real_time(drive_, part_, config, folder, signals_);
  if (!run) return run.error();
  RealtimeCell cell{plan.budget_ms, plan.condition, plan.feed, std::move(run).value(), {}};
  cell.translation_percent =
      translation_error_percent(drive_.truth, cell.run.figures.trajectory, cell.run.stamp_shift);
  std::fprintf(stderr, "%s, %s ms, %s: %llu scans, %llu poses\n", drive_.name.c_str(),
               budget_text(cell).c_str(), condition_text(cell).c_str(),
               static_cast<unsigned long long>(cell.run.figures.scans),
               static_cast<unsigned long long>(cell.run.figures.poses));
  for (const std::string& note : cell.run.notes) std::fprintf(stderr, "  %s\n", note.c_str());
  if (cell.run.watch) std::fprintf(stderr, "%s", cell.run.watch->calls.c_str());
  cells_.push_back(std::move(cell));
  std::error_code ignored;
  fs::remove_all(folder, ignored);
  return std::monostate{};
}

Result<std::monostate> RealtimeBench::measure_counted(double budget_ms) {
  std::vector<std::string> overrides = options_.overrides;
  overrides.insert(overrides.end(), {"odometry.budget=ops", budget_override(budget_ms)});
  const fs::path folder = next_folder();
  Result<NiliodFigures> figures = run_niliod_over_file({drive_.files, overrides, {}}, folder, signals_);
  if (!figures) return figures.error();
  CountedRun run{budget_ms, std::move(figures).value(), {}};
  run.translation_percent = translation_error_percent(drive_.truth, run.figures.trajectory, {});
  counted_.push_back(std::move(run));
  return std::monostate{};
}

/// Control run: shows that forbidden calls are counted.
Result<std::monostate> RealtimeBench::measure_planted() {
  const fs::path folder = next_folder();
  const std::vector<std::string> environment = watch_environment(folder, true);
  if (environment.empty()) return std::monostate{};
  const auto run = run_niliod_over_file({part_.files, options_.overrides, {}, environment}, folder, signals_);
  if (!run) return run.error();
  if (auto watch = read_thread_watch(folder)) planted_ = std::move(watch).value();
  return std::monostate{};
}

/// Replays of the part without a deadline, for the accuracy of the whole computation.
Result<std::monostate> RealtimeBench::measure_reference() {
  const auto measure = [this](bool without_imu) -> Result<std::optional<double>> {
    std::vector<std::string> overrides = options_.overrides;
    if (without_imu) overrides.emplace_back("imu.enabled=false");
    const auto run = run_niliod_over_file({part_.files, overrides, {}}, next_folder(), signals_);
    if (!run) return run.error();
    return translation_error_percent(drive_.truth, run->trajectory, {});
  };
  const auto replay = measure(false);
  if (!replay) return replay.error();
  reference_.replay = reference_.udp = *replay;
  if (!lacks_imu(drive_, options_)) return std::monostate{};
  const auto udp = measure(true);
  if (!udp) return udp.error();
  reference_.udp = *udp;
  return std::monostate{};
}

Result<std::monostate> RealtimeBench::measure_cells() {
  for (const CellPlan& plan : plan_cells(options_, drive_)) {
    if (const std::string reason = why_impossible(plan.condition); !reason.empty()) {
      page_.paragraph(std::string("Condition ") + condition_name(plan.condition) + ": skipped: " + reason);
      continue;
    }
    if (auto measured = measure_cell(plan); !measured) return measured;
  }
  return std::monostate{};
}

void RealtimeBench::add_tables() {
  page_.table("Live runs: scans, packets and degradation levels", realtime_work_table(cells_));
  page_.table("Live runs: latency", realtime_time_table(cells_));
  page_.table("Live runs: trajectories", realtime_trajectory_table(cells_));
  const auto unwatched =
      std::find_if(cells_.begin(), cells_.end(), [](const RealtimeCell& cell) { return !cell.run.watch; });
  if (unwatched != cells_.end())
    page_.paragraph("Forbidden calls of real-time threads were not counted in every run: " +
                    unwatched->run.why_not_watched);
  page_.table("Live runs: allocations, locks, exceptions and output of real-time threads after the warm-up",
              realtime_watch_table(cells_));
}

Result<std::monostate> RealtimeBench::add_pictures() {
  auto added = page_.figure("realtime-budget-" + drive_.name, "Accuracy over budget, " + drive_.name,
                            accuracy_figure(counted_, cells_), kPictureWidth, kPictureHeight);
  if (!added) return added;
  return page_.figure("realtime-latency-" + drive_.name,
                      "Last packet to published pose, " + drive_.name + "; the tables have all runs",
                      realtime_latency_figure(cells_), kPictureWidth, kPictureHeight);
}

Result<bool> RealtimeBench::run() {
  Result<WorkFolder> work = WorkFolder::create();
  if (!work) return work.error();
  work_.emplace(std::move(work).value());
  Result<DrivePart> part =
      write_beginning(drive_, core::Duration::from_seconds(options_.seconds), work_->path());
  if (!part) return part.error();
  part_ = std::move(part).value();
  page_.heading(drive_.name + ": first " + fixed(part_.length.seconds(), 1) + " s, " +
                std::to_string(part_.packets) + " packets");
  if (auto measured = measure_cells(); !measured) return measured.error();
  if (auto measured = measure_planted(); !measured) return measured.error();
  if (auto measured = measure_reference(); !measured) return measured.error();
  add_tables();
  std::vector<IdentityCheck> checks;
  if (!options_.conditions_only) {
    auto checked = check_identities(drive_, part_, run_config(), work_->path(), signals_);
    if (!checked) return checked.error();
    checks = std::move(checked).value();
    page_.table("Identity: the same input gives the same poses", identity_table(checks));
    for (const double budget : options_.budgets_ms) {
      if (auto measured = measure_counted(budget); !measured) return measured.error();
    }
    page_.table("Replays with a budget counted in operations, whole drive", counted_table(counted_));
  }
  if (auto added = add_pictures(); !added) return added.error();
  const std::vector<Requirement> requirements =
      check_requirements({cells_, counted_, checks, planted_ ? &*planted_ : nullptr, reference_});
  page_.table("Requirements", requirement_table(requirements));
  return !any_failed(requirements);
}

}  // namespace

Result<bool> run_realtime_bench(const RealtimeOptions& options) {
  StopSignals signals;
  if (const auto niliod = find_sibling_program("niliod"); !niliod) return niliod.error();
  const Result<std::vector<SensorDrive>> drives = open_sensor_drives(options.drives);
  if (!drives) return drives.error();
  Result<ResultsPage> page = ResultsPage::create(options.page, "Real time: budgets, loads and latency");
  if (!page) return page.error();
  page->paragraph(kLegend);
  bool good = true;
  for (const SensorDrive& drive : *drives) {
    if (lacks_imu(drive, options))
      page->paragraph(drive.name +
                      ": the frames of its IMU are not sent over UDP, so those runs have no IMU (--can "
                      "INTERFACE sends them); the runs \"--as-live\" read its files at the sensor's pace, "
                      "with the IMU");
    const Result<bool> met = RealtimeBench(drive, options, signals, *page).run();
    if (!met) return Error{drive.name + ": " + met.error().message};
    good = good && *met;
  }
  if (options.soak.minutes > 0.0 || options.soak.stationary_minutes > 0.0) {
    page->heading("Soak");
    SoakPlan soak = options.soak;
    soak.overrides = options.overrides;
    const Result<bool> level = add_soak(*drives, soak, signals, *page);
    if (!level) return level.error();
    good = good && *level;
  }
  if (const auto saved = page->save(); !saved) return saved.error();
  return good;
}

}  // namespace nilio::tools::bench
