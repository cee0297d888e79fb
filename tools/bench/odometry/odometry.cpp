#include "tools/bench/odometry/odometry.hpp"

#include "nilio/core/registration_method.hpp"

#include "tools/bench/odometry/ablation.hpp"
#include "tools/bench/odometry/measure.hpp"
#include "tools/bench/odometry/options.hpp"
#include "tools/bench/odometry/pcl.hpp"
#include "tools/bench/odometry/plots.hpp"
#include "tools/bench/odometry/report.hpp"
#include "tools/bench/results_page.hpp"
#include "tools/commands/number_between.hpp"
#include "tools/plot/figure.hpp"
#include "tools/plot/trajectories.hpp"

#include <algorithm>
#include <memory>
#include <variant>

namespace nilio::tools {

namespace {

using core::Error;
using core::Result;

constexpr int kMaxThreads = 64;
constexpr int kMaxRepeats = 100;
constexpr int kPictureWidth = 1600;
constexpr int kDriveHeight = 800;
constexpr int kLatencyHeight = 520;
constexpr const char* kLegend =
    "t and r: mean error over segments of the path as in the KITTI benchmark, beginning at every fifth (10 "
    "to "
    "80 m) or tenth pose (100 to 800 m). APE: rmse of positions after the best rigid alignment. RPE: rmse "
    "from "
    "scan to scan. CPU and wall time: register_scan, from the complete scan to pose and map; with several "
    "threads CPU is that of the whole process. Allocations: operator new inside it. NEES: squared error over "
    "its covariance, for each degree of freedom, of the motion from scan to scan, over ten scans, and of the "
    "twist: 1 where errors are as large as is said, less where covariances are cautious; and the share of "
    "errors within the region that is said to hold 95 %.";

struct BenchOdometryOptions {
  std::vector<std::string> datasets;
  std::vector<std::string> registrations{core::name_of(core::kRegistrationMethods.front())};
  std::vector<int> threads{1};
  std::vector<std::string> overrides;
  int repeats = 1;
  std::vector<std::string> peers;
  bool ablation = false;
  ResultsPage::Options page;
};

std::vector<std::string> method_names(const std::vector<std::string>& chosen) {
  if (std::find(chosen.begin(), chosen.end(), "all") == chosen.end()) return chosen;
  std::vector<std::string> names;
  for (const core::RegistrationMethod method : core::kRegistrationMethods)
    names.emplace_back(core::name_of(method));
  return names;
}

/// The trajectory must not depend on the number of threads.
Result<std::monostate> check_hashes(const BenchDataset& dataset, const std::vector<Measurement>& runs) {
  for (const Measurement& run : runs) {
    for (const Measurement& other : runs) {
      if (other.name != run.name || other.sha256 == run.sha256) continue;
      return Error{dataset.name + ", " + run.name + ": " + std::to_string(run.threads) + " and " +
                   std::to_string(other.threads) +
                   " threads gave different trajectories: please report this"};
    }
  }
  return std::monostate{};
}

Result<std::vector<Measurement>> measure_dataset(const BenchDataset& dataset,
                                                 const BenchOdometryOptions& options) {
  std::vector<Measurement> runs;
  for (const std::string& method : method_names(options.registrations)) {
    for (const int threads : options.threads) {
      std::vector<std::string> overrides = options.overrides;
      overrides.push_back("odometry.registration=" + method);
      overrides.push_back("odometry.threads=" + std::to_string(threads));
      Result<Measurement> run = measure_odometry(dataset, method, overrides, options.repeats);
      if (!run) return run.error();
      runs.push_back(std::move(run).value());
    }
  }
  const auto same = check_hashes(dataset, runs);
  if (!same) return same.error();
  return runs;
}

/// Trajectories of all runs, one for each method, and the time that they took.
Result<std::monostate> add_pictures(const BenchDataset& dataset, const std::vector<Measurement>& runs,
                                    ResultsPage& page) {
  if (!page.wants_pictures()) return std::monostate{};
  std::vector<Trajectory> trajectories;
  for (const Measurement& run : runs) {
    if (!trajectories.empty() && trajectories.back().path == run.name) continue;
    trajectories.push_back(run.trajectory);
    trajectories.back().path = run.name;
  }
  Trajectory truth = dataset.truth;
  truth.path = dataset.name;
  const auto figure = trajectory_figure(trajectories, truth, {}, {});
  if (!figure) return figure.error();
  const std::string drive = "trajectory-" + dataset.name;
  auto canvas = page.new_picture(drive, kPictureWidth, kDriveHeight);
  if (!canvas) return canvas.error();
  draw_figure(*canvas, *figure);
  if (auto added = page.picture(drive, "Drive and position error, " + dataset.name, *canvas); !added)
    return added;
  const std::string latency = "latency-" + dataset.name;
  canvas = page.new_picture(latency, kPictureWidth, kLatencyHeight);
  if (!canvas) return canvas.error();
  draw_latency(*canvas, runs);
  return page.picture(latency, "Time of a scan, " + dataset.name, *canvas);
}

/// PCL's CPU time as a multiple of the first run's: of all that this does with a scan, and of its
/// registration alone, as PCL gets the scans filtered and deskewed.
BenchTable peer_table(const Measurement& own, std::span<const Measurement> peers) {
  BenchTable table{
      {"", "CPU ms/scan", "times " + label_of(own), "times its registration", "t %, 10-80 m", "RPE cm"}, {}};
  const double registration = own.cpu.stages[kCoarseStage].median + own.cpu.stages[kFineStage].median;
  const auto add_row = [&](const Measurement& m) {
    const double ms = m.cpu.total.median;
    table.rows.push_back({label_of(m), fixed(ms, 2), fixed(ms / own.cpu.total.median, 1),
                          fixed(ms / registration, 1),
                          m.accuracy.near ? fixed(m.accuracy.near->translation_percent, 3) : "-",
                          fixed(100.0 * m.accuracy.rpe_m, 2)});
  };
  if (peers.empty()) return table;
  add_row(own);
  for (const Measurement& peer : peers) add_row(peer);
  return table;
}

Result<std::monostate> report_dataset(const BenchDataset& dataset, const BenchOdometryOptions& options,
                                      ResultsPage& page) {
  Result<std::vector<Measurement>> runs = measure_dataset(dataset, options);
  if (!runs) return runs.error();
  page.heading(dataset.name + ": " + std::to_string(runs->front().work.scans) + " scans, " +
               fixed(runs->front().accuracy.truth_length_m, 1) + " m");
  std::vector<Measurement> peers;
  if (!options.peers.empty()) {
    auto measured = measure_pcl(dataset, options.overrides);
    if (!measured) return measured.error();
    peers = std::move(measured).value();
  }
  const std::size_t own = runs->size();
  runs->insert(runs->end(), peers.begin(), peers.end());
  page.table("Accuracy", accuracy_table(*runs));
  page.table("Consistency of the covariances", consistency_table(*runs));
  page.table("Cost: median / 99 % / most", cost_table(*runs));
  page.table("Against PCL, median CPU time", peer_table(runs->front(), peers));
  const std::span<const Measurement> own_runs = std::span(*runs).first(own);
  page.table("Stages: median / 99 % / most", stage_table(own_runs));
  page.table("Work, mean per scan", work_table(own_runs));
  page.table("Trajectories", hash_table(own_runs));
  if (auto added = add_pictures(dataset, *runs, page); !added) return added;
  if (!options.ablation) return std::monostate{};
  const Result<BenchTable> table = ablation_table(dataset, options.overrides);
  if (!table) return table.error();
  page.table("Ablation: one choice changed at a time", *table);
  return std::monostate{};
}

Result<std::monostate> run(const BenchOdometryOptions& options) {
  std::vector<BenchDataset> datasets;
  for (const std::string& argument : options.datasets) {
    Result<BenchDataset> dataset = open_bench_dataset(argument);
    if (!dataset) return dataset.error();
    datasets.push_back(std::move(dataset).value());
  }
  Result<ResultsPage> page = ResultsPage::create(options.page, "Odometry: accuracy and cost");
  if (!page) return page.error();
  page->paragraph(kLegend);
  for (const BenchDataset& dataset : datasets) {
    const auto reported = report_dataset(dataset, options, *page);
    if (!reported) return reported;
  }
  return page->save();
}

}  // namespace

void add_bench_odometry(CLI::App& bench) {
  const auto options = std::make_shared<BenchOdometryOptions>();
  CLI::App* const command =
      bench.add_subcommand("odometry", "Accuracy, time, memory and work on drives with a truth");
  command
      ->add_option("datasets", options->datasets,
                   "FOLDER of a recording or of a KITTI sequence, with truth.tum or poses.txt in it; or "
                   "FOLDER:TRUTH")
      ->required();
  std::vector<std::string> names = method_names({"all"});
  names.emplace_back("all");
  command->add_option("--registration", options->registrations, "methods to compare, or 'all'")
      ->delimiter(',')
      ->check(CLI::IsMember(names))
      ->capture_default_str();
  command->add_option("--threads", options->threads, "numbers of threads to run each method with")
      ->delimiter(',')
      ->check(number_between(1, kMaxThreads))
      ->capture_default_str();
  command
      ->add_option("--repeats", options->repeats, "runs for each figure; of each scan the least time counts")
      ->check(number_between(1, kMaxRepeats))
      ->capture_default_str();
  command
      ->add_option("--vs", options->peers, "also run the Point Cloud Library's NDT and ICP on the same scans")
      ->check(CLI::IsMember({"pcl"}));
  command->add_flag("--ablation", options->ablation,
                    "also run with one choice of the default changed at a time");
  add_page_options(*command, options->page);
  add_override_option(*command, options->overrides,
                      "configuration of all runs, such as lidar.max_range_m=80; may be repeated");
  command->callback([options, command] { end_bench(*command, run(*options)); });
}

}  // namespace nilio::tools
