#pragma once

#include "tools/bench/bench.hpp"
#include "tools/bench/matrix/drive.hpp"
#include "tools/bench/matrix/result.hpp"
#include "tools/bench/matrix/row.hpp"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// A drive with a seed, and the rows that are run on it.
struct MatrixJob {
  DriveSpec drive;
  std::size_t number = 0;
  std::uint64_t seed = 0;
  std::vector<MatrixRow> rows;
};

/// Jobs with the seeds that were given, those of the quick matrix, or drawn ones. Run by run, so that an
/// interrupted matrix has as many seeds for every row as possible. Real drives have one seed.
std::vector<MatrixJob> make_jobs(const Matrix& matrix, const MatrixOptions& options,
                                 const std::string& commit);

/// The runs of an earlier result, row by row and seed by seed, as far as the matrix has their rows.
std::vector<MatrixJob> repeated_jobs(const Matrix& matrix, const MatrixResult& earlier);

/// The jobs without the rows that an earlier result has with their seeds, and the runs it has of them.
std::vector<MatrixJob> remaining_jobs(std::vector<MatrixJob> jobs, const MatrixResult& earlier,
                                      std::vector<MatrixRun>& kept);

/// Runs of all jobs.
std::size_t count_runs(const std::vector<MatrixJob>& jobs);

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
