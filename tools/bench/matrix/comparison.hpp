#pragma once

#include "tools/bench/matrix/result.hpp"
#include "tools/bench/matrix/statistics.hpp"
#include "tools/bench/report/results_page.hpp"

#include <cstddef>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// A row that two results have in common, on the same recordings.
struct RowComparison {
  std::string row;
  std::size_t pairs = 0;
  std::vector<double> ratios;  ///< drift now / before, of pairs that both succeed
  std::size_t new_failures = 0;
  std::size_t mended = 0;
};

/// Two results, run by run: the same row, seed and recording.
struct Comparison {
  std::vector<RowComparison> rows;
  std::size_t other_drives = 0;           ///< runs whose recording differs from the baseline's
  std::size_t unmatched = 0;              ///< runs that the baseline lacks
  MeanRatio overall;                      ///< over the rows
  double failures_p = 1.0;                ///< McNemar's test of all new failures against all mended ones
  std::vector<std::string> new_failures;  ///< "row, seed 7: silent error"
};
Comparison compare(const MatrixResult& baseline, const MatrixResult& now);

/// The verdict for every change: a new failure, an overall ratio above 1.10, or a row above 2. One line for
/// each.
std::vector<std::string> find_regressions(const Comparison& comparison);

Table comparison_table(const Comparison& comparison);
std::string describe(const Comparison& comparison);

}  // namespace nilio::tools::bench
