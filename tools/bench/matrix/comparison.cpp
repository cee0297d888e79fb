#include "tools/bench/matrix/comparison.hpp"

#include <algorithm>
#include <map>
#include <utility>

namespace nilio::tools::bench {

namespace {

constexpr double kMaxOverallRatio = 1.10;
constexpr double kMaxRowRatio = 2.0;

double drift_of(const MatrixRun& run) { return std::max(run.figures.drift_percent, kMinDriftPercent); }

RowComparison& row_named(std::vector<RowComparison>& rows, const std::string& name) {
  const auto found =
      std::find_if(rows.begin(), rows.end(), [&](const RowComparison& row) { return row.row == name; });
  if (found != rows.end()) return *found;
  rows.push_back({name, 0, {}, 0, 0});
  return rows.back();
}

void add_pair(const MatrixRun& before, const MatrixRun& now, Comparison& comparison) {
  RowComparison& row = row_named(comparison.rows, now.row);
  ++row.pairs;
  if (before.success() && now.success()) row.ratios.push_back(drift_of(now) / drift_of(before));
  if (!before.success() && now.success()) ++row.mended;
  if (!before.success() || now.success()) return;
  ++row.new_failures;
  comparison.new_failures.push_back(now.row + ", seed " + std::to_string(now.seed) + ": " +
                                    describe_failure(now.figures, now.bound_percent));
}

}  // namespace

Comparison compare(const MatrixResult& baseline, const MatrixResult& now) {
  std::map<std::pair<std::string, std::uint64_t>, const MatrixRun*> before;
  for (const MatrixRun& run : baseline.runs) before[{run.row, run.seed}] = &run;
  Comparison comparison;
  for (const MatrixRun& run : now.runs) {
    const auto found = before.find({run.row, run.seed});
    if (found == before.end()) {
      ++comparison.unmatched;
    } else if (found->second->drive_sha256 != run.drive_sha256) {
      ++comparison.other_drives;
    } else {
      add_pair(*found->second, run, comparison);
    }
  }
  std::vector<std::vector<double>> ratios;
  std::size_t new_failures = 0;
  std::size_t mended = 0;
  for (const RowComparison& row : comparison.rows) {
    ratios.push_back(row.ratios);
    new_failures += row.new_failures;
    mended += row.mended;
  }
  comparison.overall = mean_ratio(ratios);
  comparison.failures_p = mcnemar_p(new_failures, mended);
  return comparison;
}

std::vector<std::string> find_regressions(const Comparison& comparison) {
  std::vector<std::string> lines;
  for (const std::string& failure : comparison.new_failures) lines.push_back("new failure: " + failure);
  for (const RowComparison& row : comparison.rows) {
    const double ratio = geometric_mean(row.ratios);
    if (ratio > kMaxRowRatio)
      lines.push_back(row.row + ": drift is " + fixed(ratio, 2) +
                      " times the baseline's, at most 2 are allowed");
  }
  if (comparison.overall.ratio > kMaxOverallRatio)
    lines.push_back("all rows: drift is " + fixed(comparison.overall.ratio, 3) +
                    " times the baseline's, at most 1.10 are allowed");
  return lines;
}

Table comparison_table(const Comparison& comparison) {
  Table table{{"row", "pairs", "drift ratio", "95 %", "new failures", "mended"}, {}};
  for (const RowComparison& row : comparison.rows) {
    const MeanRatio ratio = mean_ratio(std::vector<std::vector<double>>{row.ratios});
    table.rows.push_back({row.row, std::to_string(row.pairs), fixed(ratio.ratio, 3),
                          fixed(ratio.interval.low, 2) + "-" + fixed(ratio.interval.high, 2),
                          std::to_string(row.new_failures), std::to_string(row.mended)});
  }
  return table;
}

std::string describe(const Comparison& comparison) {
  const MeanRatio& overall = comparison.overall;
  std::string text = "Drift against the baseline, geometric mean of " + std::to_string(overall.values) +
                     " pairs, stratified by row: " + fixed(overall.ratio, 3) +
                     " (95 %: " + fixed(overall.interval.low, 3) + " to " + fixed(overall.interval.high, 3) +
                     "). Failures: McNemar's p " + fixed(comparison.failures_p, 3) + ".";
  if (comparison.other_drives > 0)
    text +=
        " Not compared, because the recording is another one: " + std::to_string(comparison.other_drives) +
        " runs.";
  if (comparison.unmatched > 0)
    text += " Not in the baseline: " + std::to_string(comparison.unmatched) + " runs.";
  return text;
}

}  // namespace nilio::tools::bench
