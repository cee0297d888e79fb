#include "tools/bench/realism/realism.hpp"

#include "tools/bench/matrix/row.hpp"
#include "tools/bench/odometry/run.hpp"
#include "tools/bench/realism/scan_statistics.hpp"
#include "tools/simulate/simulate.hpp"

#include <algorithm>
#include <filesystem>
#include <map>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Result;

/// KITTI's HDL-64E turned with 9.66 Hz, the simulated one with 10 Hz.
constexpr double kRealFirings = 2157.0;
constexpr double kSimulatedFirings = 2083.0;
constexpr double kSensorHeightM = 1.73;
const char* const kIterations = "ICP iterations a scan";

/// Bounds for a healthy HDL-64E in a town: the interval of two real drives of one sensor, widened by 10 to 25
/// %.
const std::map<std::string, std::vector<std::pair<double, double>>>& bounds() {
  static const std::map<std::string, std::vector<std::pair<double, double>>> table{
      {"areal voxels thinner than 3 / 5, thicker than 10 cm, %", {{55, 78}, {70, 91}, {0.5, 4}}},
      {"vertical thickness p50 / 75 / 90 / 97, mm", {{17, 36}, {28, 60}, {42, 85}, {63, 110}}},
      {"ground thickness p50 / 75 / 90 / 97, mm", {{3, 5}, {6.5, 11.5}, {14, 24}, {28, 48}}},
      {"noise in the ring 3-20 / 20-30 / 30-50 m, mm", {{7, 11.5}, {9, 15}, {12, 24}}},
      {"ring bias, mm; correlation of odd and even scans", {{15, 25}, {0.8, 1}}},
      {"residual to own voxel's plane p50 / 90 / 99, mm", {{6, 11}, {38, 70}, {105, 170}}},
      {"returned share; below -20 deg", {{0.82, 0.92}, {0.55, 0.75}}},
      {"points beyond 2 m, thousands a scan", {{108, 122}}},
      {"range 2-5 / 5-10 / 10-20 / 20-30 / 30-50 / 50-80 m, %",
       {{5, 14}, {38, 50}, {20, 30}, {7, 15}, {5, 11}, {2, 5}}},
      {"holes, ground 3-15 / 15-25 m; other 3-15 / 15-30 m, %",
       {{0.05, 0.4}, {0.2, 0.6}, {0.6, 2.2}, {0.8, 2}}},
      {"isolated points, %; P(mixed); its first fifth, %", {{0.05, 0.3}, {0.025, 0.13}, {60, 100}}},
      {"voxels of 8 points a scan; areal share", {{2700, 3900}, {0.55, 0.70}}},
      {"intensity median / p95; zero, %", {{60, 85}, {100, 135}, {8, 15}}},
      {kIterations, {{3.3, 7.4}}}};
  return table;
}

using Rows = std::vector<ScanStatistics::Row>;

/// Folder for one simulated drive, removed afterwards.
class DriveFolder {
 public:
  explicit DriveFolder(std::uint64_t seed)
      : path_(fs::temp_directory_path() /
              ("nilio-realism-" + std::to_string(getpid()) + "-" + std::to_string(seed))) {}
  DriveFolder(const DriveFolder&) = delete;
  DriveFolder& operator=(const DriveFolder&) = delete;
  ~DriveFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  [[nodiscard]] std::string path() const { return path_.string(); }

 private:
  fs::path path_;
};

Result<Rows> measure(const std::string& dataset_argument, double firings, int every) {
  auto dataset = open_bench_dataset(dataset_argument);
  if (!dataset) return dataset.error();
  // Simulated without an IMU, and registration takes fewer iterations with one.
  auto config = bench_config(*dataset, {"imu.enabled=false"});
  if (!config) return config.error();
  ScanStatistics statistics(firings, kSensorHeightM);
  std::size_t seen = 0;
  const auto look = [&](const core::Scan& scan, const core::OdometryResult& /*result*/,
                        const core::Odometry& /*odometry*/) {
    // Whole revolutions only.
    if (seen++ % static_cast<std::size_t>(every) == 0 && scan.coverage_deg > 350.0F) statistics.add(scan);
  };
  const auto run = run_odometry(*dataset, *config, nullptr, look);
  if (!run) return run.error();
  double iterations = 0.0;
  std::size_t tracked = 0;
  for (const core::OdometryResult& result : run->results) {
    // The initial velocity search registers one scan many times.
    if (result.state == core::TrackingState::kInitialising) continue;
    iterations += result.fine_iterations;
    ++tracked;
  }
  Rows rows = statistics.rows();
  rows.push_back({kIterations, {iterations / static_cast<double>(std::max<std::size_t>(tracked, 1))}, 2});
  return rows;
}

Result<Rows> measure_simulated(const RealismOptions& options, std::uint64_t seed) {
  const DriveFolder folder(seed);
  simulate::Options drive;
  drive.output = folder.path();
  drive.sensor = drivers::VelodyneModel::kHdl64eS2;
  drive.seed = seed;
  drive.extent.duration_s = options.seconds;
  drive.moving_start = true;
  drive.imu = "none";
  drive.realism = options.realism == "ideal"  ? simulate::Realism::kIdeal
                  : options.realism == "poor" ? simulate::Realism::kPoor
                                              : simulate::Realism::kTypical;
  if (!options.effects.empty()) {
    const auto effects = simulate::parse_effects(options.effects);
    if (!effects) return effects.error();
    drive.effects = *effects;
  }
  const auto written = simulate::write_recording(drive);
  if (!written) return written.error();
  return measure(folder.path(), kSimulatedFirings, options.every);
}

std::string joined(const std::vector<double>& values, int digits) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : " / ") + fixed(value, digits);
  return text;
}

std::string list_of(const std::vector<std::uint64_t>& seeds) {
  std::string text;
  for (const std::uint64_t seed : seeds) text += (text.empty() ? "" : ", ") + std::to_string(seed);
  return text;
}

}  // namespace

std::size_t RealismRow::outside() const {
  std::size_t count = 0;
  for (std::size_t i = 0; i < simulated.size(); ++i)
    if (!(simulated[i] >= low[i] && simulated[i] <= high[i])) ++count;
  return count;
}

Result<std::vector<RealismRow>> compare_with_recording(const RealismOptions& options) {
  const Result<Rows> real = measure(options.recording, kRealFirings, options.every);
  if (!real) return real.error();
  std::vector<RealismRow> table;
  for (const ScanStatistics::Row& row : *real) {
    RealismRow& added = table.emplace_back();
    added.name = row.name;
    added.digits = row.digits;
    added.real = row.values;
    added.simulated.assign(row.values.size(), 0.0);
    for (const auto& [low, high] : bounds().at(row.name)) {
      added.low.push_back(low);
      added.high.push_back(high);
    }
  }
  for (const std::uint64_t seed : options.seeds) {
    const Result<Rows> simulated = measure_simulated(options, seed);
    if (!simulated) return simulated.error();
    for (std::size_t r = 0; r < table.size(); ++r) {
      for (std::size_t i = 0; i < table[r].simulated.size(); ++i)
        table[r].simulated[i] += (*simulated)[r].values[i] / static_cast<double>(options.seeds.size());
    }
  }
  return table;
}

Result<bool> run_realism_bench(const RealismOptions& given) {
  RealismOptions options = given;
  const std::string commit = find_commit(options.commit);
  for (std::size_t i = 1; given.seeds.empty() && i <= options.runs; ++i)
    options.seeds.push_back(draw_seed(commit, "realism", i));
  auto page = ResultsPage::create(options.page, "Simulated and real scans");
  if (!page) return page.error();
  const auto rows = compare_with_recording(options);
  if (!rows) return rows.error();
  Table table{{"figure", "real", "simulated", "bounds", "verdict"}, {}};
  std::size_t outside = 0;
  for (const RealismRow& row : *rows) {
    std::string range;
    for (std::size_t i = 0; i < row.low.size(); ++i)
      range += (range.empty() ? "" : " / ") + joined({row.low[i]}, row.digits) + "-" +
               joined({row.high[i]}, row.digits);
    outside += row.outside() > 0 ? 1U : 0U;
    table.rows.push_back({row.name, joined(row.real, row.digits), joined(row.simulated, row.digits), range,
                          row.outside() == 0 ? "within" : std::to_string(row.outside()) + " outside"});
  }
  page->paragraph(
      "Real: KITTI raw drive 0009, HDL-64E, as recorded. Simulated: HDL-64E in the town, `--realism " +
      options.realism + "`, mean of the seeds " + list_of(options.seeds) +
      (given.seeds.empty() ? " (drawn by commit " + commit.substr(0, 12) + "), " : ", ") +
      fixed(options.seconds, 0) + " s each from a moving start. One scan in " +
      std::to_string(options.every) +
      ". Bounds: the interval of two real drives of one sensor in one city, widened by 10 to 25 %.");
  page->table("Scans", table);
  page->paragraph(std::to_string(rows->size() - outside) + " of " + std::to_string(rows->size()) +
                  " rows are within their bounds.");
  const auto saved = page->save();
  if (!saved) return saved.error();
  return outside == 0;
}

}  // namespace nilio::tools::bench
