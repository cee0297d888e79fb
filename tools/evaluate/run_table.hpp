#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::evaluate {

/// Numbers of one run from its result.json.
struct RunNumbers {
  int exit_status = 0;
  std::uint64_t poses = 0;
  double tracking_percent = 0.0;
  double degraded_percent = 0.0;
  double lost_percent = 0.0;
  std::uint64_t resets = 0;  ///< map resets after initialisation, and relocalisations
  double path_length_m = 0.0;
  double duration_s = 0.0;
  double cpu_s = 0.0;
  std::string time_source;
  std::string version;
  std::string configuration_hash;
  std::string trajectory_sha256;
};

/// A run and what is wrong with it; empty: nothing.
struct RunRow {
  std::string run;
  std::optional<RunNumbers> numbers;  ///< empty without a readable result.json
  std::string problem;
};

struct RunLimits {
  std::optional<double> max_lost_percent;
  std::optional<std::uint64_t> max_resets;
};

/// Reads result.json of an output folder of niliod (or the file itself) and compares it with the limits. A
/// missing or damaged file, a status other than 0 and an exceeded limit are the row's problem.
RunRow read_run(const std::string& path, const RunLimits& limits);

/// One line per run and a summary, for a terminal.
std::string run_table_text(const std::vector<RunRow>& rows);
/// The same with full values; the first line names the columns (RFC 4180).
std::string run_table_csv(const std::vector<RunRow>& rows);
/// {"runs": [...], "problems": n}.
std::string run_table_json(const std::vector<RunRow>& rows);

}  // namespace nilio::tools::evaluate
