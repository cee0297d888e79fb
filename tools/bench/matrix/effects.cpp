#include "tools/bench/matrix/statistics.hpp"
#include "tools/bench/matrix/summary.hpp"
#include "tools/simulate/realism.hpp"

#include <algorithm>
#include <map>

namespace nilio::tools::bench {

namespace {

constexpr const char* kIdeal = "ideal";
constexpr const char* kAll = "all";
constexpr double kBoundPercent = 1.0;

std::vector<std::string> variants() {
  std::vector<std::string> names{kIdeal};
  names.insert(names.end(), simulate::effect_names().begin(), simulate::effect_names().end());
  names.emplace_back(kAll);
  return names;
}

std::string drive_name(const std::string& sensor, const std::string& variant) {
  return "effects " + sensor + " " + variant;
}

/// Successful runs of a row by seed.
std::map<std::uint64_t, double> drifts_of(const MatrixResult& result, const std::string& row) {
  std::map<std::uint64_t, double> drifts;
  for (const MatrixRun& run : result.runs) {
    if (run.row == row && run.success())
      drifts[run.seed] = std::max(run.figures.drift_percent, kMinDriftPercent);
  }
  return drifts;
}

std::string ratio_cell(const MatrixResult& result, const std::string& row, const std::string& ideal) {
  const auto before = drifts_of(result, ideal);
  std::vector<double> ratios;
  for (const auto& [seed, drift] : drifts_of(result, row)) {
    if (const auto found = before.find(seed); found != before.end()) ratios.push_back(drift / found->second);
  }
  if (ratios.empty()) return "-";
  const MeanRatio mean = mean_ratio(std::vector<std::vector<double>>{ratios});
  return fixed(mean.ratio, 2) + " (" + fixed(mean.interval.low, 2) + "-" + fixed(mean.interval.high, 2) + ")";
}

}  // namespace

Matrix effects_matrix() {
  Matrix matrix;
  for (const std::string sensor : {"vlp16", "hdl64e"}) {
    for (const std::string& variant : variants()) {
      DriveSpec drive;
      drive.name = drive_name(sensor, variant);
      drive.draws_as = "effects " + sensor;
      drive.options = {"--scene",    "town", "--sensor",  sensor,
                       "--duration", "20",   "--realism", variant == kIdeal ? "ideal" : "typical"};
      if (variant != kIdeal && variant != kAll)
        drive.options.insert(drive.options.end(), {"--effects", variant});
      matrix.rows.push_back({drive.name, drive.name, true, {}, kBoundPercent});
      matrix.rows.push_back({drive.name + kNoImu, drive.name, false, {}, kBoundPercent});
      matrix.drives.push_back(std::move(drive));
    }
  }
  return matrix;
}

Table effects_table(const MatrixResult& result, const std::string& sensor) {
  const std::vector<RowSummary> summaries = summarise_rows(result, "");
  Table table{{"effect", "IMU: success", "drift %", "ratio to ideal (95 %)", "no IMU: success", "drift %",
               "ratio to ideal (95 %)"},
              {}};
  for (const std::string& variant : variants()) {
    std::vector<std::string> cells{variant};
    bool has_runs = false;
    for (const std::string suffix : {"", kNoImu}) {
      const std::string row = drive_name(sensor, variant) + suffix;
      const auto found = std::find_if(summaries.begin(), summaries.end(),
                                      [&](const RowSummary& summary) { return summary.row == row; });
      if (found == summaries.end()) {
        cells.insert(cells.end(), 3, "-");
        continue;
      }
      has_runs = true;
      cells.push_back(std::to_string(found->successes) + "/" + std::to_string(found->runs));
      cells.push_back(fixed(found->drift_percent, 3));
      cells.push_back(ratio_cell(result, row, drive_name(sensor, kIdeal) + suffix));
    }
    if (has_runs) table.rows.push_back(std::move(cells));
  }
  return table;
}

}  // namespace nilio::tools::bench
