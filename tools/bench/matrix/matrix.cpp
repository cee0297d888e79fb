#include "nilio/core/clock.hpp"

#include "daemon/exit_status.hpp"
#include "tools/bench/bench.hpp"
#include "tools/bench/matrix/comparison.hpp"
#include "tools/bench/matrix/jobs.hpp"
#include "tools/bench/matrix/summary.hpp"
#include "tools/common/child_process.hpp"
#include "tools/common/files.hpp"
#include "tools/common/system.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <optional>
#include <set>
#include <system_error>
#include <thread>
#include <utility>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Duration;
using core::Error;
using core::Result;

constexpr const char* kLegend =
    "Success: never a silent error, and a drift within the bound; with the 95 % interval of Wilson. Drift: "
    "mean translation "
    "error over segments of 10 to 80 m (KITTI metric), and RPE: rmse from scan to scan; geometric means of "
    "the successful "
    "runs. NEES: squared error of the motion over one second over its covariance, for each degree of "
    "freedom: 1 for a "
    "correct covariance; drift NEES: that of the last pose since the start, over its drift covariance. "
    "Silent error: seconds in which the motion over the last second was off by more than "
    "0.10 m + 2 % "
    "or 1 degree while the state said tracking; mean of all runs. Recovery: longest time until tracking was "
    "regained. CPU: "
    "mean of a scan, one thread. Seeds are drawn from the commit and the run number.";

/// Takes out the rows of real drives whose recordings are not there; returns their names.
std::vector<std::string> take_rows_without_data(Matrix& matrix, const DriveSources& sources) {
  std::vector<std::string> skipped;
  for (const DriveSpec& drive : matrix.drives) {
    if (is_available(drive, sources)) continue;
    std::erase_if(matrix.rows, [&](const MatrixRow& row) {
      if (row.drive == drive.name) skipped.push_back(row.name);
      return row.drive == drive.name;
    });
  }
  std::erase_if(matrix.drives, [&](const DriveSpec& drive) { return !is_available(drive, sources); });
  return skipped;
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

/// How a matrix ended.
enum class End : std::uint8_t { kDone, kTime, kSignal };

/// Runs all jobs beside this thread, which waits for signals and the end of the time.
End run_until_stopped(const std::vector<MatrixJob>& jobs, const RunnerOptions& runner, double minutes,
                      StopSignals& signals, MatrixResult& result) {
  const std::int64_t end_ns = monotonic_ns() + static_cast<std::int64_t>(minutes * 60e9);
  MatrixProgress progress(count_runs(jobs));
  std::atomic<bool> stop{false};
  std::atomic<bool> finished{false};
  std::jthread worker([&] {
    run_jobs(jobs, runner, stop, [&](MatrixRun run) {
      progress.show(run);
      result.runs.push_back(std::move(run));
    });
    finished = true;
  });
  End end = End::kDone;
  while (!finished) {
    if (signals.wait(kPoll)) end = End::kSignal;
    if (end == End::kDone && minutes > 0.0 && monotonic_ns() > end_ns) end = End::kTime;
    if (end != End::kDone) stop = true;
  }
  worker.join();
  return end;
}

std::vector<std::string> names_of(const Matrix& matrix) {
  std::vector<std::string> names;
  for (const MatrixRow& row : matrix.rows) names.push_back(row.name);
  return names;
}

/// In the order of the matrix, whatever order they were done in.
void sort_runs(const std::vector<std::string>& rows, std::vector<MatrixRun>& runs) {
  std::map<std::string, std::size_t> order;
  for (const std::string& row : rows) order.emplace(row, order.size());
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
  return write_text(path, to_json(result));
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

Matrix matrix_of(const MatrixOptions& options) {
  if (options.effects) return effects_matrix();
  return options.quick ? quick_matrix() : full_matrix();
}

const char* option_of(const MatrixOptions& options) {
  if (options.effects) return "--effects ";
  return options.quick ? "--quick " : "";
}

/// Which part of the matrix the tables show.
std::string describe_extent(const MatrixOptions& options, const MatrixResult& result,
                            const std::vector<MatrixJob>& jobs, End end) {
  std::set<std::string> rows;
  for (const MatrixRun& run : result.runs) rows.insert(run.row);
  const std::size_t all = matrix_of(options).rows.size();
  std::string text = "Commit " + result.commit + ": " + std::to_string(result.runs.size()) + " of " +
                     std::to_string(count_runs(jobs)) + " runs, on " + std::to_string(rows.size()) +
                     " of the " + std::to_string(all) + " rows of the matrix";
  if (options.sample > 0 || options.minutes > 0.0) text += ", which the commit draws";
  if (end == End::kTime) text += "; ended after " + fixed(options.minutes, 0) + " minutes";
  if (end == End::kSignal) text += "; interrupted";
  const auto successes = std::count_if(result.runs.begin(), result.runs.end(),
                                       [](const MatrixRun& run) { return run.success(); });
  return text + ". " + std::to_string(successes) + " of these runs succeed.";
}

void report_tables(const MatrixOptions& options, const MatrixResult& result,
                   const std::vector<MatrixJob>& jobs, End end, ResultsPage& page) {
  page.paragraph(kLegend);
  page.paragraph(describe_extent(options, result, jobs, end));
  if (const std::string skipped = describe_skipped(result); !skipped.empty()) page.paragraph(skipped + ".");
  page.table("Real drives", matrix_table(result, false));
  page.table("Simulated drives", matrix_table(result, true));
  for (const char* sensor : {"vlp16", "hdl64e"}) {
    if (options.effects) page.table(std::string("Effects, town, ") + sensor, effects_table(result, sensor));
  }
  page.table("Peers on the same recordings", peer_table(result));
  page.table("Failures", failure_table(result, option_of(options)));
  page.table("Seeds", seed_table(jobs));
}

}  // namespace

Result<int> run_matrix_bench(const MatrixOptions& options) {
  StopSignals signals;
  const auto work = WorkFolder::create();
  if (!work) return work.error();
  auto runner = runner_options(options, work->path());
  if (!runner) return runner.error();
  Matrix matrix = matrix_of(options);
  if (!options.rows.empty()) matrix = select_rows(std::move(matrix), options.rows);
  if (matrix.rows.empty()) return Error{"--rows " + options.rows + ": matches no row - --list shows them"};
  if (options.list) {
    for (const MatrixRow& row : matrix.rows) std::printf("%s\n", row.name.c_str());
    return static_cast<int>(kDone);
  }
  MatrixResult result;
  result.skipped = take_rows_without_data(matrix, runner->sources);
  if (const std::string skipped = describe_skipped(result); !skipped.empty())
    std::fprintf(stderr, "%s\n", skipped.c_str());
  if (matrix.rows.empty()) return Error{"no row can be run without recordings"};
  result.version = NILIO_VERSION;
  std::optional<MatrixResult> earlier;
  if (const std::string& path = options.repeat.empty() ? options.resume : options.repeat; !path.empty()) {
    auto read = read_matrix_result(path);
    if (!read) return read.error();
    earlier = std::move(read).value();
  }
  result.commit = options.resume.empty() ? find_commit(options.commit) : earlier->commit;
  result.command = current_command_line();
  const std::vector<std::string> order = names_of(matrix);
  std::vector<MatrixJob> jobs;
  if (options.repeat.empty()) {
    // The drives of a part come in drawn order, so that the part is a fair one.
    if (options.sample > 0 || options.minutes > 0.0)
      matrix = draw_rows(std::move(matrix), result.commit,
                         options.sample > 0 ? options.sample : matrix.rows.size());
    jobs = make_jobs(matrix, options, result.commit);
  } else {
    jobs = repeated_jobs(matrix, *earlier);
    if (jobs.empty()) return Error{options.repeat + ": has no run of this matrix - --list shows its rows"};
  }
  auto page = ResultsPage::create(
      options.page, options.effects ? "Drift with each effect of realism alone and with all"
                                    : "Success, drift and silent errors over scenes, sensors and faults");
  if (!page) return page.error();
  const std::vector<MatrixJob> remaining =
      options.resume.empty() ? jobs : remaining_jobs(jobs, *earlier, result.runs);
  const End end = run_until_stopped(remaining, *runner, options.minutes, signals, result);
  result.complete = end == End::kDone;
  sort_runs(order, result.runs);
  report_tables(options, result, jobs, end, *page);
  const std::string& baseline = options.repeat.empty() ? options.baseline : options.repeat;
  const auto regressions = report_comparison(baseline, result, *page);
  if (!regressions) return regressions.error();
  if (const auto written = write_result(options.json, result); !written) return written.error();
  if (const auto saved = page->save(); !saved) return saved.error();
  for (const std::string& line : *regressions) std::fprintf(stderr, "regression: %s\n", line.c_str());
  if (end == End::kSignal) return kInterrupted;
  return static_cast<int>(regressions->empty() ? kDone : kBadResult);
}

}  // namespace nilio::tools::bench
