#include "tools/bench/matrix/summary.hpp"

#include <algorithm>
#include <cmath>
#include <set>

namespace nilio::tools::bench {

namespace {

constexpr double kMinRpeM = 1e-6;

const RunFigures* figures_of(const MatrixRun& run, const std::string& peer) {
  if (peer.empty()) return &run.figures;
  const auto found = run.peers.find(peer);
  return found == run.peers.end() ? nullptr : &found->second;
}

/// Figures of one row and the sums behind its means.
class RowSum {
 public:
  void add(const RunFigures& f, double bound_percent) {
    ++summary_.runs;
    summary_.bound_percent = bound_percent;
    if (is_success(f, bound_percent)) {
      ++summary_.successes;
      drifts_.push_back(std::max(f.drift_percent, kMinDriftPercent));
      rpes_.push_back(std::max(f.rpe_m, kMinRpeM));
    }
    if (!f.failure.empty()) return;
    ++measured_;
    nees_ += f.nees * static_cast<double>(f.nees_count);
    nees_count_ += f.nees_count;
    drift_nees_ += f.drift_nees;
    silent_s_ += f.silent_error_s;
    cpu_ms_ += f.cpu_ms;
    summary_.recovery_s = std::max(summary_.recovery_s, f.recovery_s);
  }
  [[nodiscard]] RowSummary summary(const std::string& row) const {
    RowSummary s = summary_;
    s.row = row;
    s.success_interval = wilson_interval(s.successes, s.runs);
    s.drift_percent = geometric_mean(drifts_);
    s.rpe_m = geometric_mean(rpes_);
    s.nees = nees_count_ > 0 ? nees_ / static_cast<double>(nees_count_) : std::nan("");
    s.drift_nees = measured_ > 0 ? drift_nees_ / static_cast<double>(measured_) : std::nan("");
    s.silent_error_s = measured_ > 0 ? silent_s_ / static_cast<double>(measured_) : std::nan("");
    s.cpu_ms = measured_ > 0 ? cpu_ms_ / static_cast<double>(measured_) : std::nan("");
    return s;
  }

 private:
  RowSummary summary_;
  std::vector<double> drifts_;
  std::vector<double> rpes_;
  std::size_t measured_ = 0;
  double nees_ = 0.0;
  std::size_t nees_count_ = 0;
  double drift_nees_ = 0.0;
  double silent_s_ = 0.0;
  double cpu_ms_ = 0.0;
};

std::string success_cell(const RowSummary& row) {
  return std::to_string(row.successes) + "/" + std::to_string(row.runs) + " (" +
         fixed(100.0 * row.success_interval.low, 0) + "-" + fixed(100.0 * row.success_interval.high, 0) +
         " %)";
}

}  // namespace

bool is_simulated_row(const std::string& row) { return !row.starts_with("KITTI"); }

std::string describe_skipped(const MatrixResult& result) {
  std::string rows;
  for (const std::string& row : result.skipped) rows += (rows.empty() ? ": " : "; ") + row;
  return rows.empty() ? ""
                      : "skipped: no data (NILIO_DATA or --data) for " +
                            std::to_string(result.skipped.size()) + " rows" + rows;
}

std::vector<RowSummary> summarise_rows(const MatrixResult& result, const std::string& peer) {
  std::vector<std::string> order;
  std::map<std::string, RowSum> sums;
  for (const MatrixRun& run : result.runs) {
    const RunFigures* const figures = figures_of(run, peer);
    if (figures == nullptr) continue;
    if (!sums.contains(run.row)) order.push_back(run.row);
    sums[run.row].add(*figures, run.bound_percent);
  }
  std::vector<RowSummary> rows;
  for (const std::string& row : order) rows.push_back(sums[row].summary(row));
  return rows;
}

std::vector<std::string> peer_names(const MatrixResult& result) {
  std::set<std::string> names;
  for (const MatrixRun& run : result.runs) {
    for (const auto& [name, figures] : run.peers) names.insert(name);
  }
  return {names.begin(), names.end()};
}

Table matrix_table(const MatrixResult& result, bool simulated) {
  Table table{{"row", "success (95 %)", "bound %", "drift %", "RPE cm", "NEES", "drift NEES",
               "silent error s", "recovery s", "CPU ms"},
              {}};
  for (const RowSummary& row : summarise_rows(result, "")) {
    if (is_simulated_row(row.row) != simulated) continue;
    table.rows.push_back({row.row, success_cell(row), fixed(row.bound_percent, 0),
                          fixed(row.drift_percent, 3), fixed(100.0 * row.rpe_m, 2), fixed(row.nees, 2),
                          fixed(row.drift_nees, 2), fixed(row.silent_error_s, 1), fixed(row.recovery_s, 1),
                          fixed(row.cpu_ms, 2)});
  }
  return table;
}

Table peer_table(const MatrixResult& result) {
  const std::vector<std::string> peers = peer_names(result);
  if (peers.empty()) return {};
  Table table{{"row", "nilio: success", "drift %"}, {}};
  std::vector<std::vector<RowSummary>> summaries;
  for (const std::string& peer : peers) {
    table.headings.push_back(peer + ": success");
    table.headings.emplace_back("drift %");
    summaries.push_back(summarise_rows(result, peer));
  }
  for (const RowSummary& own : summarise_rows(result, "")) {
    std::vector<std::string> cells{own.row, success_cell(own), fixed(own.drift_percent, 3)};
    for (const auto& summary : summaries) {
      const auto found = std::find_if(summary.begin(), summary.end(),
                                      [&](const RowSummary& row) { return row.row == own.row; });
      cells.push_back(found == summary.end() ? "-" : success_cell(*found));
      cells.push_back(found == summary.end() ? "-" : fixed(found->drift_percent, 3));
    }
    table.rows.push_back(std::move(cells));
  }
  return table;
}

Table failure_table(const MatrixResult& result, const std::string& options) {
  Table table{{"row", "failure", "drift %", "silent error s", "command"}, {}};
  for (const MatrixRun& run : result.runs) {
    if (run.success()) continue;
    const std::string kind = describe_failure(run.figures, run.bound_percent);
    const bool measured = run.figures.failure.empty();
    table.rows.push_back({run.row, measured ? kind : run.figures.failure,
                          measured ? fixed(run.figures.drift_percent, 2) : "-",
                          measured ? fixed(run.figures.silent_error_s, 1) : "-",
                          "`nilio bench matrix " + options + "--rows '" + run.row + "' --seeds " +
                              std::to_string(run.seed) + "`"});
  }
  return table;
}

}  // namespace nilio::tools::bench
