#include "nilio/core/clock.hpp"

#include "daemon/exit_status.hpp"
#include "tools/bench/bench.hpp"
#include "tools/bench/matrix/comparison.hpp"
#include "tools/bench/matrix/runner.hpp"
#include "tools/bench/matrix/summary.hpp"
#include "tools/common/child_process.hpp"
#include "tools/common/files.hpp"
#include "tools/common/system.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <system_error>
#include <thread>
#include <utility>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Duration;
using core::Error;
using core::Result;

constexpr Duration kPoll = Duration::from_milliseconds(100.0);
constexpr std::size_t kQuickSeeds = 2;
constexpr const char* kLegend =
    "Success: never a silent error, and a drift within the bound; with the 95 % interval of Wilson. Drift: "
    "mean translation "
    "error over segments of 10 to 80 m (KITTI metric), and RPE: rmse from scan to scan; geometric means of "
    "the successful "
    "runs. NEES: squared error of the motion over one second over its covariance, for each degree of "
    "freedom: 1 for a "
    "correct covariance. Silent error: seconds in which the motion over the last second was off by more than "
    "0.10 m + 2 % "
    "or 1 degree while the state said tracking; mean of all runs. Recovery: longest time until tracking was "
    "regained. CPU: "
    "mean of a scan, one thread. Seeds are drawn from the commit and the run number.";

/// The commit that is measured: given, or that of the working folder.
std::string find_commit(const std::string& given) {
  if (!given.empty()) return given;
  std::string text;
  if (FILE* const pipe = popen("git rev-parse HEAD 2>/dev/null", "re"); pipe != nullptr) {
    char line[128];
    if (std::fgets(line, sizeof line, pipe) != nullptr) text = line;
    pclose(pipe);
  }
  while (!text.empty() && text.back() == '\n') text.pop_back();
  return text.empty() ? NILIO_VERSION : text;
}

/// Seeds of a drive: given, fixed for the quick matrix, or drawn. Real drives have one.
std::vector<std::uint64_t> seeds_of(const DriveSpec& drive, const MatrixOptions& options,
                                    const std::string& commit) {
  std::vector<std::uint64_t> seeds = options.seeds;
  if (seeds.empty() && options.quick) {
    for (std::size_t i = 1; i <= kQuickSeeds; ++i) seeds.push_back(i);
  }
  for (std::size_t i = 1; seeds.empty() || (options.seeds.empty() && !options.quick && i <= options.runs);
       ++i)
    seeds.push_back(draw_seed(commit, drive.name, i));
  const bool has_one = drive.kind != DriveKind::kSimulated && options.seeds.empty();
  if (has_one) seeds.resize(1);
  return seeds;
}

/// Run by run, so that an interrupted matrix has as many seeds for every row as possible.
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

/// Leaves out the real drives whose recordings are not there, with a line for each.
Matrix available_rows(Matrix matrix, const DriveSources& sources) {
  for (const DriveSpec& drive : matrix.drives) {
    if (is_available(drive, sources)) continue;
    std::fprintf(stderr, "skipped: no data for %s - set NILIO_DATA or --data\n", drive.name.c_str());
    std::erase_if(matrix.rows, [&](const MatrixRow& row) { return row.drive == drive.name; });
  }
  std::erase_if(matrix.drives, [&](const DriveSpec& drive) { return !is_available(drive, sources); });
  return matrix;
}

/// One line for each run on standard error, with the remaining time.
class MatrixProgress {
 public:
  explicit MatrixProgress(std::size_t total) : total_(total), begin_ns_(monotonic_ns()) {}

  void show(const MatrixRun& run) {
    ++done_;
    const double elapsed_s = static_cast<double>(monotonic_ns() - begin_ns_) * 1e-9;
    const double left_s = elapsed_s * static_cast<double>(total_ - done_) / static_cast<double>(done_);
    const std::string failure = describe_failure(run.figures, run.bound_percent);
    const std::string drift =
        run.figures.failure.empty() ? fixed(run.figures.drift_percent, 3) + " %" : run.figures.failure;
    std::fprintf(stderr, "[%zu/%zu, %.0f min left] %s, seed %llu: %s%s%s\n", done_, total_, left_s / 60.0,
                 run.row.c_str(), static_cast<unsigned long long>(run.seed), drift.c_str(),
                 failure.empty() ? "" : " - ", failure.c_str());
  }

 private:
  std::size_t total_;
  std::size_t done_ = 0;
  std::int64_t begin_ns_;
};

Result<RunnerOptions> runner_options(const MatrixOptions& options, const fs::path& work) {
  RunnerOptions runner;
  const auto nilio = find_sibling_program("nilio");
  if (!nilio) return nilio.error();
  const char* const environment = std::getenv("NILIO_DATA");
  runner.sources = {!options.data.empty() ? options.data : environment != nullptr ? environment : "", *nilio};
  runner.work = work;
  runner.overrides = options.overrides;
  runner.jobs = options.jobs;
  if (!options.drives.empty()) {
    std::error_code error;
    fs::create_directories(options.drives, error);
    if (error) return Error{options.drives + ": cannot be created (" + error.message() + ")"};
    runner.drives = options.drives;
  }
  for (const std::string& peer : options.peers) {
    const std::size_t equals = peer.find('=');
    if (equals == std::string::npos || equals == 0 || !fs::is_directory(peer.substr(equals + 1)))
      return Error{"--peer " + peer + ": needs NAME=FOLDER, a folder with ROW_SEED.tum files"};
    runner.peers[peer.substr(0, equals)] = peer.substr(equals + 1);
  }
  return runner;
}

/// Runs all jobs beside this thread, which waits for signals. Returns whether all were done.
bool run_until_stopped(const std::vector<MatrixJob>& jobs, const RunnerOptions& runner, StopSignals& signals,
                       MatrixResult& result) {
  std::size_t total = 0;
  for (const MatrixJob& job : jobs) total += job.rows.size();
  MatrixProgress progress(total);
  std::atomic<bool> stop{false};
  std::atomic<bool> finished{false};
  std::jthread worker([&] {
    run_jobs(jobs, runner, stop, [&](MatrixRun run) {
      progress.show(run);
      result.runs.push_back(std::move(run));
    });
    finished = true;
  });
  while (!finished) {
    if (signals.wait(kPoll)) stop = true;
  }
  worker.join();
  return !stop;
}

/// In the order of the matrix, whatever order they were done in.
void sort_runs(const Matrix& matrix, std::vector<MatrixRun>& runs) {
  std::map<std::string, std::size_t> order;
  for (const MatrixRow& row : matrix.rows) order.emplace(row.name, order.size());
  std::sort(runs.begin(), runs.end(), [&](const MatrixRun& a, const MatrixRun& b) {
    return std::pair(order[a.row], a.number) < std::pair(order[b.row], b.number);
  });
}

Table seed_table(const std::vector<MatrixJob>& jobs) {
  Table table{{"drive", "seeds"}, {}};
  for (const MatrixJob& job : jobs) {
    const auto found = std::find_if(table.rows.begin(), table.rows.end(),
                                    [&](const auto& row) { return row[0] == job.drive.name; });
    if (found != table.rows.end()) {
      (*found)[1] += ", " + std::to_string(job.seed);
    } else if (job.drive.kind == DriveKind::kSimulated) {
      table.rows.push_back({job.drive.name, std::to_string(job.seed)});
    }
  }
  return table;
}

Result<std::monostate> write_result(const std::string& path, const MatrixResult& result) {
  if (path.empty()) return std::monostate{};
  std::ofstream file(path);
  file << to_json(result);
  if (file.flush()) return std::monostate{};
  return Error{path + ": cannot be written - check the folder and the space on the disk"};
}

/// Adds the comparison with a baseline; returns the regressions.
Result<std::vector<std::string>> report_comparison(const std::string& path, const MatrixResult& result,
                                                   ResultsPage& page) {
  if (path.empty()) return std::vector<std::string>{};
  const auto baseline = read_matrix_result(path);
  if (!baseline) return baseline.error();
  const Comparison comparison = compare(*baseline, result);
  page.heading("Against " + fs::path(path).filename().string() + " (" + baseline->commit.substr(0, 12) + ")");
  page.paragraph(describe(comparison));
  page.table("Ratios of the drifts of runs that succeed in both", comparison_table(comparison));
  return find_regressions(comparison);
}

void report_tables(const MatrixOptions& options, const MatrixResult& result,
                   const std::vector<MatrixJob>& jobs, ResultsPage& page) {
  page.paragraph(kLegend);
  page.paragraph("Commit " + result.commit + ", " + std::to_string(result.runs.size()) + " runs" +
                 (result.complete ? "." : ", interrupted: rows have the runs that were done."));
  page.table("Real drives", matrix_table(result, false));
  page.table("Simulated drives", matrix_table(result, true));
  page.table("Peers on the same recordings", peer_table(result));
  page.table("Failures", failure_table(result, options.quick ? "--quick " : ""));
  page.table("Seeds", seed_table(jobs));
}

}  // namespace

Result<int> run_matrix_bench(const MatrixOptions& options) {
  StopSignals signals;
  const auto work = WorkFolder::create();
  if (!work) return work.error();
  auto runner = runner_options(options, work->path());
  if (!runner) return runner.error();
  Matrix matrix = options.quick ? quick_matrix() : full_matrix();
  if (!options.rows.empty()) matrix = select_rows(std::move(matrix), options.rows);
  if (matrix.rows.empty()) return Error{"--rows " + options.rows + ": matches no row - --list shows them"};
  if (options.list) {
    for (const MatrixRow& row : matrix.rows) std::printf("%s\n", row.name.c_str());
    return static_cast<int>(kDone);
  }
  matrix = available_rows(std::move(matrix), runner->sources);
  if (matrix.rows.empty()) return Error{"no row can be run without recordings"};
  MatrixResult result;
  result.version = NILIO_VERSION;
  result.commit = find_commit(options.commit);
  result.command = current_command_line();
  const std::vector<MatrixJob> jobs = make_jobs(matrix, options, result.commit);
  auto page =
      ResultsPage::create(options.page, "Success, drift and silent errors over scenes, sensors and faults");
  if (!page) return page.error();
  result.complete = run_until_stopped(jobs, *runner, signals, result);
  sort_runs(matrix, result.runs);
  report_tables(options, result, jobs, *page);
  const auto regressions = report_comparison(options.baseline, result, *page);
  if (!regressions) return regressions.error();
  if (const auto written = write_result(options.json, result); !written) return written.error();
  if (const auto saved = page->save(); !saved) return saved.error();
  for (const std::string& line : *regressions) std::fprintf(stderr, "regression: %s\n", line.c_str());
  if (!result.complete) return kInterrupted;
  return static_cast<int>(regressions->empty() ? kDone : kBadResult);
}

}  // namespace nilio::tools::bench
