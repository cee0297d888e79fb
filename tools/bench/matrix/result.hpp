#pragma once

#include "tools/bench/matrix/row.hpp"
#include "tools/bench/matrix/run_figures.hpp"

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// One run of a row.
struct MatrixRun {
  std::string row;
  std::size_t number = 0;
  std::uint64_t seed = 0;
  std::string drive_sha256;  ///< of the recording; runs of two results are compared only on equal ones
  double bound_percent = 0.0;
  RunFigures figures;
  std::map<std::string, RunFigures> peers;  ///< by name

  [[nodiscard]] bool success() const { return is_success(figures, bound_percent); }
};

/// Result of a matrix: what was measured, and every run.
struct MatrixResult {
  std::string version;
  std::string commit;
  std::string command;
  bool complete = false;  ///< false: interrupted, the runs so far
  std::vector<MatrixRun> runs;
  std::vector<std::string> skipped{};  ///< rows of real drives whose recordings were not there
};

/// As JSON; reading fails with the file and the reason.
std::string to_json(const MatrixResult& result);
core::Result<MatrixResult> read_matrix_result(const std::string& path);

}  // namespace nilio::tools::bench
