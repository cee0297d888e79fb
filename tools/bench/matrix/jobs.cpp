#include "tools/bench/matrix/jobs.hpp"

#include <algorithm>

namespace nilio::tools::bench {

namespace {

constexpr std::size_t kQuickSeeds = 2;

/// Seeds of a drive: given, fixed for the quick matrix, or drawn. Real drives have one.
std::vector<std::uint64_t> seeds_of(const DriveSpec& drive, const MatrixOptions& options,
                                    const std::string& commit) {
  std::vector<std::uint64_t> seeds = options.seeds;
  if (seeds.empty() && options.quick) {
    for (std::size_t i = 1; i <= kQuickSeeds; ++i) seeds.push_back(i);
  }
  for (std::size_t i = 1; seeds.empty() || (options.seeds.empty() && !options.quick && i <= options.runs);
       ++i)
    seeds.push_back(draw_seed(commit, drive.draws_as.empty() ? drive.name : drive.draws_as, i));
  const bool has_one = drive.kind != DriveKind::kSimulated && options.seeds.empty();
  if (has_one) seeds.resize(1);
  return seeds;
}

}  // namespace

std::vector<MatrixJob> make_jobs(const Matrix& matrix, const MatrixOptions& options,
                                 const std::string& commit) {
  std::vector<MatrixJob> jobs;
  for (const DriveSpec& drive : matrix.drives) {
    const std::vector<std::uint64_t> seeds = seeds_of(drive, options, commit);
    for (std::size_t i = 0; i < seeds.size(); ++i) {
      MatrixJob job{drive, i + 1, seeds[i], {}};
      for (const MatrixRow& row : matrix.rows) {
        if (row.drive == drive.name) job.rows.push_back(row);
      }
      jobs.push_back(std::move(job));
    }
  }
  std::stable_sort(jobs.begin(), jobs.end(),
                   [](const MatrixJob& a, const MatrixJob& b) { return a.number < b.number; });
  return jobs;
}

std::vector<MatrixJob> repeated_jobs(const Matrix& matrix, const MatrixResult& earlier) {
  std::vector<MatrixJob> jobs;
  for (const DriveSpec& drive : matrix.drives) {
    const std::size_t first = jobs.size();
    for (const MatrixRow& row : matrix.rows) {
      if (row.drive != drive.name) continue;
      for (const MatrixRun& run : earlier.runs) {
        if (run.row != row.name) continue;
        auto job = std::find_if(jobs.begin() + static_cast<std::ptrdiff_t>(first), jobs.end(),
                                [&](const MatrixJob& j) { return j.seed == run.seed; });
        if (job == jobs.end()) job = jobs.insert(jobs.end(), {drive, run.number, run.seed, {}});
        job->rows.push_back(row);
      }
    }
  }
  return jobs;
}

std::size_t count_runs(const std::vector<MatrixJob>& jobs) {
  std::size_t runs = 0;
  for (const MatrixJob& job : jobs) runs += job.rows.size();
  return runs;
}

}  // namespace nilio::tools::bench
