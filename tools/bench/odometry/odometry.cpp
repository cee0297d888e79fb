#include "nilio/core/odometry_config.hpp"

#include "tools/bench/bench.hpp"
#include "tools/bench/odometry/measure.hpp"
#include "tools/bench/odometry/report.hpp"
#include "tools/plot/trajectories.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <variant>

namespace nilio::tools::bench {

namespace {

using core::Error;
using core::Result;

constexpr int kPictureWidth = 1600;
constexpr int kDriveHeight = 800;
constexpr int kLatencyHeight = 520;
constexpr const char* kLegend =
    "t and r: mean translation and rotation error over segments of the path as in the KITTI benchmark, "
    "beginning at every fifth (10 to 80 m) or tenth pose (100 to 800 m). APE: RMSE of positions after the "
    "best "
    "rigid alignment. RPE: RMSE from scan to scan. CPU and wall time: register_scan(), from the complete "
    "scan "
    "to pose and map; with several threads, CPU time of the whole process. Allocations: calls of operator "
    "new "
    "inside it. NEES: squared error over its covariance for each degree of freedom, of the motion from scan "
    "to "
    "scan, of the motion over ten scans, and of the twist: 1 for a correct covariance, less for one that is "
    "too "
    "large. Inside 95 %: share of the errors inside the covariance's 95 % region.";

struct Change {
  const char* meaning;
  const char* setting;  ///< of niliod's configuration
};

constexpr std::array<Change, 16> kChanges = {{
    {"no ICP: NDT alone", "odometry.registration=ndt"},
    {"no NDT: ICP alone", "odometry.registration=icp_plane"},
    {"lines instead of planes", "odometry.registration=icp_line"},
    {"points instead of planes", "odometry.registration=icp_point"},
    {"NDT before every ICP", "odometry.coarse=always"},
    {"one pass of deskewing and registration", "odometry.max_passes=1"},
    {"500 points", "odometry.registration_points=500"},
    {"8000 points", "odometry.registration_points=8000"},
    {"3 ICP iterations a pass", "odometry.max_fine_iterations=3"},
    {"beams as calibrated", "odometry.calibrate_beams=false"},
    {"map points in voxels of 1 m", "odometry.filter_voxel_m=1.0"},
    {"planes in voxels of 1 m", "odometry.plane_voxel_m=1.0"},
    {"planes in voxels of 2 m", "odometry.plane_voxel_m=2.0"},
    {"map of 50 m", "odometry.map_radius_m=50"},
    {"no IMU", "imu.enabled=false"},
    {"elevation angles of the data set", "lidar.elevation_correction_deg=0"},
}};

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
                   " threads gave different trajectories - please report this"};
    }
  }
  return std::monostate{};
}

Result<std::vector<Measurement>> measure_dataset(const BenchDataset& dataset,
                                                 const OdometryOptions& options) {
  std::vector<Measurement> runs;
  for (const std::string& method : method_names(options.registrations)) {
    for (const int threads : options.threads) {
      std::vector<std::string> overrides = options.overrides;
      overrides.push_back("odometry.registration=" + method);
      overrides.push_back("odometry.threads=" + std::to_string(threads));
      std::fprintf(stderr, "%s: %s, %d threads\n", dataset.name.c_str(), method.c_str(), threads);
      Result<Measurement> run = measure_odometry(dataset, method, overrides, options.repeats);
      if (!run) return run.error();
      runs.push_back(std::move(run).value());
    }
  }
  const auto same = check_hashes(dataset, runs);
  if (!same) return same.error();
  return runs;
}

/// Adds the trajectories and the times of the first run of each method.
Result<std::monostate> add_pictures(const BenchDataset& dataset, const std::vector<Measurement>& runs,
                                    ResultsPage& page) {
  std::vector<Trajectory> trajectories;
  for (const Measurement& run : runs) {
    const bool is_known = !trajectories.empty() && trajectories.back().path == run.name;
    if (is_known || trajectories.size() == plot::kMaxCurves) continue;
    trajectories.push_back(run.trajectory);
    trajectories.back().path = run.name;
  }
  Trajectory truth = dataset.truth;
  truth.path = dataset.name;
  const auto figure = plot::trajectory_figure(trajectories, truth, {}, {});
  if (!figure) return figure.error();
  if (auto added = page.figure("trajectory-" + dataset.name, "Drive and position error, " + dataset.name,
                               *figure, kPictureWidth, kDriveHeight);
      !added)
    return added;
  return page.figure("latency-" + dataset.name, "Time of a scan, " + dataset.name, latency_figure(runs),
                     kPictureWidth, kLatencyHeight);
}

Result<std::monostate> report_dataset(const BenchDataset& dataset, const OdometryOptions& options,
                                      ResultsPage& page) {
  Result<std::vector<Measurement>> runs = measure_dataset(dataset, options);
  if (!runs) return runs.error();
  page.heading(dataset.name + ": " + std::to_string(runs->front().work.scans) + " scans, " +
               fixed(runs->front().accuracy.truth_length_m, 1) + " m");
  std::vector<Measurement> pcl;
  if (options.with_pcl) {
    auto measured = measure_pcl(dataset, options.overrides);
    if (!measured) return measured.error();
    pcl = std::move(measured).value();
  }
  const std::size_t own = runs->size();
  runs->insert(runs->end(), pcl.begin(), pcl.end());
  page.table("Accuracy", accuracy_table(*runs));
  page.table("Consistency of the covariances", consistency_table(*runs));
  page.table("Cost: median / 99 % / maximum", cost_table(*runs));
  page.table("Against PCL, median CPU time", pcl_table(runs->front(), pcl));
  const std::span<const Measurement> own_runs = std::span(*runs).first(own);
  page.table("Stages: median / 99 % / maximum", stage_table(own_runs));
  page.table("Work, mean per scan", work_table(own_runs));
  page.table("Trajectories", hash_table(own_runs));
  if (auto added = add_pictures(dataset, *runs, page); !added) return added;
  if (!options.ablation) return std::monostate{};
  const Result<Table> table = measure_ablation(dataset, options.overrides);
  if (!table) return table.error();
  page.table("Ablation: one setting changed at a time", *table);
  return std::monostate{};
}

}  // namespace

Result<Table> measure_ablation(const BenchDataset& dataset, const std::vector<std::string>& overrides) {
  Result<Measurement> reference = measure_odometry(dataset, "default", overrides, 1);
  if (!reference) return reference.error();
  const std::string sha256 = reference->sha256;
  std::vector<AblationRow> rows{{"default", "", std::move(reference).value()}};
  for (const Change& change : kChanges) {
    std::fprintf(stderr, "%s: ablation, %s\n", dataset.name.c_str(), change.meaning);
    std::vector<std::string> changed = overrides;
    changed.emplace_back(change.setting);
    Result<Measurement> run = measure_odometry(dataset, change.meaning, changed, 1);
    if (!run) return run.error();
    if (run->sha256 != sha256) rows.push_back({change.meaning, change.setting, std::move(run).value()});
  }
  return ablation_table(rows);
}

Result<bool> run_odometry_bench(const OdometryOptions& options) {
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
    if (const auto reported = report_dataset(dataset, options, *page); !reported) return reported.error();
  }
  if (const auto saved = page->save(); !saved) return saved.error();
  return true;
}

}  // namespace nilio::tools::bench
