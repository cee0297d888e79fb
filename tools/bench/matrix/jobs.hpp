#pragma once

#include "tools/bench/bench.hpp"
#include "tools/bench/matrix/result.hpp"
#include "tools/bench/matrix/row.hpp"

#include <cstddef>
#include <cstdint>
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

/// Runs of all jobs.
std::size_t count_runs(const std::vector<MatrixJob>& jobs);

}  // namespace nilio::tools::bench
