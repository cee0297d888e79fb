#pragma once

#include "tools/bench/matrix/result.hpp"
#include "tools/bench/matrix/statistics.hpp"
#include "tools/bench/report/results_page.hpp"

#include <cstddef>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// One line of the matrix.
struct RowSummary {
  std::string row;
  std::size_t runs = 0;
  std::size_t successes = 0;
  Interval success_interval;
  double bound_percent = 0.0;
  /// Geometric means of the successful runs; NaN for none.
  double drift_percent = 0.0;
  double rpe_m = 0.0;
  double nees = 0.0;            ///< mean of all values
  double drift_nees = 0.0;      ///< the same
  double silent_error_s = 0.0;  ///< mean of all runs
  double recovery_s = 0.0;      ///< longest
  double cpu_ms = 0.0;          ///< mean
};

/// Rows in the order of their first run. `peer` empty: nilio.
std::vector<RowSummary> summarise_rows(const MatrixResult& result, const std::string& peer);

std::vector<std::string> peer_names(const MatrixResult& result);
Table matrix_table(const MatrixResult& result, bool simulated);
Table peer_table(const MatrixResult& result);
/// Failed runs with the command that repeats them; `options` are those of the matrix, such as "--quick ".
Table failure_table(const MatrixResult& result, const std::string& options);
/// Drift and success in effects_matrix() by effect for one sensor, with the paired ratio to the ideal drives.
Table effects_table(const MatrixResult& result, const std::string& sensor);
/// "skipped: no data (NILIO_DATA or --data) for 2 rows: KITTI 04; ..." or empty.
std::string describe_skipped(const MatrixResult& result);
/// Whether a row's drive is simulated, by its name.
bool is_simulated_row(const std::string& row);

}  // namespace nilio::tools::bench
