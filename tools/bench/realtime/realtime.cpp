#include "tools/bench/realtime/realtime.hpp"

#include "tools/bench/common/niliod_run.hpp"
#include "tools/bench/common/sensor_drive.hpp"
#include "tools/bench/odometry/options.hpp"
#include "tools/bench/realtime/identity_checks.hpp"
#include "tools/bench/realtime/realtime_run.hpp"
#include "tools/bench/realtime/realtime_summary.hpp"
#include "tools/bench/realtime/realtime_table.hpp"
#include "tools/bench/results_page.hpp"
#include "tools/bench/soak/soak_section.hpp"
#include "tools/commands/number_between.hpp"
#include "tools/common/stop_signals.hpp"
#include "tools/common/work_folder.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>
#include <variant>

namespace nilio::tools {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

constexpr std::uint64_t kMebibyte = 1024 * 1024;
constexpr int kPictureWidth = 1200;
constexpr int kPictureHeight = 620;
constexpr const char* kLegend =
    "Two numbers are 50 % / 99 %, three 50 % / 99 % / most; wake-up has 99 % / most. Past the budget: the "
    "hand-over, after the last packet's arrival plus the budget. To hand-over, to DDS, to subscriber: from "
    "that arrival to the pose put into the publisher's ring, to the return of DDS write(), and to a "
    "subscriber of this computer. IMU pose: from the CAN frame to the return of DDS write(). Wake-up: how "
    "late a thread that sleeps to absolute times, every millisecond, is woken meanwhile: SCHED_FIFO 80, or "
    "normal where that is not allowed. Sender late: 99 % of the packets were sent no later than that.";

struct BenchRealtimeOptions {
  std::vector<std::string> drives;
  std::vector<double> budgets_ms{50.0, 20.0, 10.0, 5.0, 2.0, 1.0};
  std::vector<std::string> conditions{"idle", "hogs", "memory", "subscriber"};
  bool full = false;
  double seconds = 15.0;
  std::string feed = "udp";
  std::uint64_t memory_mib = 4096;
  RealtimeRunConfig run;
  SoakPlan soak;
  ResultsPage::Options page;
};

struct CellPlan {
  std::optional<double> budget_ms;
  Condition condition = Condition::kIdle;
  Feed feed = Feed::kUdp;
};

/// There is an IMU, whose frames no socket of this computer takes.
bool lacks_imu(const SensorDrive& drive, const RealtimeRunConfig& run) {
  return run.feed == Feed::kUdp && run.can_interface.empty() && !drive.files.can_logs.empty();
}

/// Every budget on an idle computer, or under all conditions, and all conditions under the configured budget.
/// Where the IMU's frames are not sent, idle and hogs once more from the files, with the IMU.
std::vector<CellPlan> plan_cells(const BenchRealtimeOptions& options, const SensorDrive& drive) {
  std::vector<Condition> conditions;
  for (const std::string& name : options.conditions) conditions.push_back(*parse_condition(name));
  std::vector<CellPlan> plan;
  const Feed feed = options.run.feed;
  for (const double budget : options.budgets_ms) {
    if (!options.full) {
      plan.push_back({budget, Condition::kIdle, feed});
      continue;
    }
    for (const Condition condition : conditions) plan.push_back({budget, condition, feed});
  }
  for (const Condition condition : conditions) plan.push_back({std::nullopt, condition, feed});
  if (lacks_imu(drive, options.run)) {
    for (const Condition condition : {Condition::kIdle, Condition::kHogs})
      plan.push_back({std::nullopt, condition, Feed::kReplay});
  }
  return plan;
}

std::string budget_override(double budget_ms) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "odometry.budget_ms=%g", budget_ms);
  return text.data();
}

/// All of one drive.
class RealtimeBench {
 public:
  RealtimeBench(const SensorDrive& drive, const BenchRealtimeOptions& options, StopSignals& signals,
                ResultsPage& page)
      : drive_(drive), options_(options), signals_(signals), page_(page) {}

  /// True when nothing failed.
  Result<bool> run();

 private:
  Result<std::monostate> measure_cell(const CellPlan& plan);
  Result<std::monostate> measure_counted(double budget_ms);
  Result<std::monostate> measure_planted();
  void add_tables();
  Result<std::monostate> add_pictures();
  fs::path next_folder() { return work_->path() / ("run" + std::to_string(runs_++)); }

  const SensorDrive& drive_;
  const BenchRealtimeOptions& options_;
  StopSignals& signals_;
  ResultsPage& page_;
  std::optional<WorkFolder> work_;
  DrivePart part_;
  int runs_ = 0;
  std::vector<RealtimeCell> cells_;
  std::vector<CountedRun> counted_;
  std::optional<ThreadWatch> planted_;
};

Result<std::monostate> RealtimeBench::measure_cell(const CellPlan& plan) {
  RealtimeRunConfig config = options_.run;
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
  std::vector<std::string> overrides = options_.run.overrides;
  overrides.insert(overrides.end(), {"odometry.budget=ops", budget_override(budget_ms)});
  const fs::path folder = next_folder();
  Result<RunFigures> figures = run_niliod_over_file({drive_.files, overrides, {}}, folder, signals_);
  if (!figures) return figures.error();
  CountedRun run{budget_ms, std::move(figures).value(), {}};
  run.translation_percent = translation_error_percent(drive_.truth, run.figures.trajectory, {});
  counted_.push_back(std::move(run));
  return std::monostate{};
}

/// Shows that what a real-time thread must not do is counted.
Result<std::monostate> RealtimeBench::measure_planted() {
  const fs::path folder = next_folder();
  const std::vector<std::string> environment = watch_environment(folder, true);
  if (environment.empty()) return std::monostate{};
  const auto run =
      run_niliod_over_file({part_.files, options_.run.overrides, {}, environment}, folder, signals_);
  if (!run) return run.error();
  if (auto watch = read_thread_watch(folder)) planted_ = std::move(watch).value();
  return std::monostate{};
}

void RealtimeBench::add_tables() {
  page_.table("In real time: what was done", realtime_work_table(cells_));
  page_.table("In real time: when", realtime_time_table(cells_));
  page_.table("In real time: where", realtime_trajectory_table(cells_));
  const auto unwatched =
      std::find_if(cells_.begin(), cells_.end(), [](const RealtimeCell& cell) { return !cell.run.watch; });
  if (unwatched != cells_.end())
    page_.paragraph("Allocations in real-time threads: not measured in every run: " +
                    unwatched->run.why_not_watched);
  page_.table("In real time: allocations, locks, exceptions and output after the warm-up",
              realtime_watch_table(cells_));
}

Result<std::monostate> RealtimeBench::add_pictures() {
  if (!page_.wants_pictures()) return std::monostate{};
  const auto add = [this](const std::string& name, const std::string& caption,
                          const Chart& chart) -> Result<std::monostate> {
    if (chart.curves.empty()) return std::monostate{};
    auto canvas = page_.new_picture(name, kPictureWidth, kPictureHeight);
    if (!canvas) return canvas.error();
    draw_chart(*canvas, chart);
    return page_.picture(name, caption, *canvas);
  };
  if (auto added = add("budget-" + drive_.name, "Accuracy against budget, " + drive_.name,
                       accuracy_chart(counted_, cells_));
      !added)
    return added;
  return add("latency-" + drive_.name, "Last packet to pose, " + drive_.name, latency_chart(cells_));
}

Result<bool> RealtimeBench::run() {
  Result<WorkFolder> work = WorkFolder::create();
  if (!work) return work.error();
  work_.emplace(std::move(work).value());
  Result<DrivePart> part =
      write_beginning(drive_, core::Duration::from_seconds(options_.seconds), work_->path());
  if (!part) return part.error();
  part_ = std::move(part).value();
  page_.heading(drive_.name + ": its first " + fixed(part_.length.seconds(), 1) + " s, " +
                std::to_string(part_.packets) + " packets");
  for (const CellPlan& plan : plan_cells(options_, drive_)) {
    if (auto measured = measure_cell(plan); !measured) return measured.error();
  }
  if (auto measured = measure_planted(); !measured) return measured.error();
  add_tables();
  const Result<std::vector<IdentityCheck>> checks =
      check_identities(drive_, part_, options_.run, work_->path(), signals_);
  if (!checks) return checks.error();
  page_.table("The same input gives the same poses", identity_table(*checks));
  for (const double budget : options_.budgets_ms) {
    if (auto measured = measure_counted(budget); !measured) return measured.error();
  }
  page_.table("Without a clock: budget counted in operations, all of the drive", counted_table(counted_));
  if (auto added = add_pictures(); !added) return added.error();
  const std::vector<Demand> demands =
      judge_realtime({cells_, counted_, *checks, planted_ ? &*planted_ : nullptr});
  page_.table("What is asked, and what came of it", demand_table(demands));
  return !any_failed(demands);
}

Result<bool> run(BenchRealtimeOptions& options) {
  StopSignals signals;
  options.run.memory_bytes = options.memory_mib * kMebibyte;
  options.run.feed = options.feed == "udp" ? Feed::kUdp : Feed::kReplay;
  if (const auto niliod = find_sibling_program("niliod"); !niliod) return niliod.error();
  const Result<std::vector<SensorDrive>> drives = open_sensor_drives(options.drives);
  if (!drives) return drives.error();
  Result<ResultsPage> page = ResultsPage::create(options.page, "In real time: budgets, loads and latency");
  if (!page) return page.error();
  page->paragraph(kLegend);
  bool good = true;
  for (const SensorDrive& drive : *drives) {
    if (lacks_imu(drive, options.run))
      page->paragraph(drive.name +
                      ": the frames of its IMU are not sent over UDP, so those runs are without it (--can "
                      "INTERFACE sends them); the runs \"--as-live\" read its files at the sensor's pace, "
                      "with the IMU");
    const Result<bool> same = RealtimeBench(drive, options, signals, *page).run();
    if (!same) return Error{drive.name + ": " + same.error().message};
    good = good && *same;
  }
  if (options.soak.minutes > 0.0 || options.soak.standing_minutes > 0.0) {
    page->heading("Soak");
    options.soak.overrides = options.run.overrides;
    options.soak.domain = options.run.domain;
    const Result<bool> level = add_soak(*drives, options.soak, signals, *page);
    if (!level) return level.error();
    good = good && *level;
  }
  if (const auto saved = page->save(); !saved) return saved.error();
  return good;
}

void add_load_options(CLI::App& command, BenchRealtimeOptions& o) {
  command.add_option("--budgets", o.budgets_ms, "odometry.budget_ms of the runs, milliseconds")
      ->delimiter(',')
      ->check(number_between(0.1, 1000.0))
      ->capture_default_str();
  command
      .add_option("--conditions", o.conditions,
                  "what else the computer has to do under the configured budget")
      ->delimiter(',')
      ->check(CLI::IsMember({"idle", "hogs", "memory", "subscriber"}))
      ->capture_default_str();
  command.add_flag("--full", o.full, "run every budget under every condition");
  command.add_option("--seconds", o.seconds, "length of each run: the drive's beginning")
      ->check(number_between(1.0, 3600.0))
      ->capture_default_str();
  command
      .add_option("--memory-mib", o.memory_mib,
                  "most that condition 'memory' takes; it takes no more than nine tenths of what is free")
      ->check(number_between(1.0, 1e6))
      ->capture_default_str();
}

void add_soak_options(CLI::App& command, BenchRealtimeOptions& o) {
  command
      .add_option("--soak", o.soak.minutes,
                  "then play so many minutes of the drives as fast as they go, as 'bench soak' does")
      ->check(number_between(0.1, 1e5));
  command.add_option("--standing", o.soak.standing_minutes, "and so many of a simulated standstill")
      ->check(number_between(0.1, 1e5));
}

void add_feed_options(CLI::App& command, BenchRealtimeOptions& o) {
  command
      .add_option(
          "--feed", o.feed,
          "udp: packets are sent to niliod's socket; replay: niliod --replay --as-live paces the files, "
          "with the IMU")
      ->check(CLI::IsMember({"udp", "replay"}))
      ->capture_default_str();
  command.add_option("--can", o.run.can_interface,
                     "CAN interface (such as vcan0) to send the IMU's frames on beside UDP");
  command
      .add_option("--port", o.run.port,
                  "UDP port to send to, and the next for position packets (0: any free one)")
      ->check(number_between(0.0, 65534.0))
      ->capture_default_str();
  add_domain_option(command, o.run.domain);
}

}  // namespace

void add_bench_realtime(CLI::App& bench) {
  const auto options = std::make_shared<BenchRealtimeOptions>();
  CLI::App* const command = bench.add_subcommand("realtime",
                                                 "niliod and its publisher at the sensor's pace: budgets, "
                                                 "loads, latency, identity of poses, and a soak");
  command->footer(
      "Each run starts niliod, found beside this program, and feeds it the drive's first seconds. Afterwards "
      "the "
      "same\n"
      "input has to give the same poses over file and socket, with 1, 2 and 4 threads, idle and loaded, and "
      "from "
      "the\n"
      "decision log of a run that was out of its budget. Real-time threads are watched by libnilio-watch.so, "
      "where\n"
      "it is beside this program.\n"
      "Exit status: 0; 1 when something failed that does not rest on the clock, or could not be run.");
  command
      ->add_option(
          "drives", options->drives,
          "FOLDER of 'nilio simulate' or of a recording, or a capture; its truth is truth.tum in the "
          "folder, or DRIVE:TRUTH")
      ->required();
  add_load_options(*command, *options);
  add_feed_options(*command, *options);
  add_soak_options(*command, *options);
  add_page_options(*command, options->page);
  add_override_option(*command, options->run.overrides, "configuration of all runs; may be repeated");
  command->callback([options, command] { end_bench(*command, run(*options)); });
}

}  // namespace nilio::tools
