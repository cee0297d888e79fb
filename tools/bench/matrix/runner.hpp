#pragma once

#include "tools/bench/matrix/drive.hpp"
#include "tools/bench/matrix/jobs.hpp"
#include "tools/bench/matrix/result.hpp"

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::bench {

struct RunnerOptions {
  DriveSources sources;
  std::filesystem::path work;                          ///< temporary files
  std::optional<std::filesystem::path> drives;         ///< drives are kept there, and used where they are
  std::map<std::string, std::filesystem::path> peers;  ///< folders of TUM files by name
  std::vector<std::string> overrides;                  ///< of nilio's configuration
  std::size_t jobs = 2;                                ///< at the same time
};

/// Name of a run's drive in `drives`, and of a peer's trajectory: ROW_SEED.tum.
std::string drive_id(const DriveSpec& drive, std::uint64_t seed);
std::string run_id(const MatrixRow& row, std::uint64_t seed);

/// Runs the jobs, several at a time, and calls `done` after each run, one call at a time. Ends early when
/// `stop` is set; runs that it interrupted are left out.
void run_jobs(const std::vector<MatrixJob>& jobs, const RunnerOptions& options, const std::atomic<bool>& stop,
              const std::function<void(MatrixRun)>& done);

}  // namespace nilio::tools::bench
