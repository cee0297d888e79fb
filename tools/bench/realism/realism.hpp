#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/report/results_page.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// `nilio bench realism`: simulated HDL-64E scans of the town beside a real recording.
struct RealismOptions {
  std::string recording;             ///< FOLDER or FOLDER:TRUTH of KITTI's raw drive 0009
  std::vector<std::uint64_t> seeds;  ///< towns; empty = `runs` that the commit draws
  std::size_t runs = 3;              ///< their mean is compared
  std::string commit;                ///< that the seeds are drawn from; empty = of the working folder
  std::vector<std::string> effects;  ///< these alone, for studies; empty = those of `realism`
  double seconds = 10.0;             ///< of each simulated drive
  int every = 4;                     ///< every so many scans are looked at
  std::string realism = "typical";
  ResultsPage::Options page;
};

/// One row of the comparison.
struct RealismRow {
  std::string name;
  std::vector<double> real;
  std::vector<double> simulated;
  std::vector<double> low;
  std::vector<double> high;
  int digits = 1;

  /// Values outside their bounds.
  [[nodiscard]] std::size_t outside() const;
};

/// The rows, in the order of the published table.
core::Result<std::vector<RealismRow>> compare_with_recording(const RealismOptions& options);
/// Prints and writes the table; false if a row is outside its bounds.
core::Result<bool> run_realism_bench(const RealismOptions& options);

}  // namespace nilio::tools::bench
