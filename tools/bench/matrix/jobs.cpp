#include "tools/bench/matrix/jobs.hpp"

#include "nilio/core/clock.hpp"

#include "daemon/input/replay_files.hpp"
#include "tools/bench/common/replay.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/mangle/mangle.hpp"

#include <algorithm>
#include <ctime>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

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

std::int64_t thread_cpu_ns() { return clock_ns(CLOCK_THREAD_CPUTIME_ID); }

/// A folder that is removed with this object.
class ScratchFolder {
 public:
  explicit ScratchFolder(fs::path path) : path_(std::move(path)) { remove(); }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  ~ScratchFolder() { remove(); }
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  void remove() const {
    std::error_code ignored;
    for (const char* suffix : {"", ".log", ".work"}) fs::remove_all(path_.string() + suffix, ignored);
  }
  fs::path path_;
};

/// Moves a folder, also to another file system. Another run may have put the same drive there meanwhile.
Result<std::monostate> move_folder(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::rename(from, to, error);
  if (!error) return std::monostate{};
  std::error_code ignored;
  if (fs::exists(to / "truth.tum", ignored)) return std::monostate{};
  error.clear();
  fs::copy(from, to, fs::copy_options::recursive, error);
  if (!error) return std::monostate{};
  // A part of a drive would be taken for all of it.
  fs::remove_all(to, ignored);
  return Error{to.string() + ": the drive cannot be kept: " + error.message()};
}

bool has_faults(const mangle::Faults& faults) {
  return faults.changes_packets() || faults.changes_scans() || faults.changes_returns();
}

/// One run after another of a drive.
class JobRunner {
 public:
  JobRunner(const RunnerOptions& options, const std::atomic<bool>& stop,
            const std::function<void(MatrixRun)>& done)
      : options_(options), stop_(stop), done_(done) {}

  void run(const MatrixJob& job) {
    const std::string id = drive_id(job.drive, job.seed);
    const bool keeps = options_.drives.has_value();
    const fs::path kept = keeps ? *options_.drives / id : fs::path();
    const ScratchFolder scratch(options_.work / id);
    std::error_code ignored;
    const bool is_there = keeps && fs::exists(kept / "truth.tum", ignored);
    if (!is_there) {
      const auto made = make_drive(job.drive, job.seed, options_.sources, scratch.path(), stop_);
      if (!made) return fail_all(job, made.error());
      if (keeps) {
        if (const auto moved = move_folder(scratch.path(), kept); !moved) return fail_all(job, moved.error());
      }
    }
    const fs::path folder = keeps ? kept : scratch.path();
    const auto hash = hash_drive(folder);
    if (!hash) return fail_all(job, hash.error());
    for (const MatrixRow& row : job.rows) {
      if (stop_) return;
      MatrixRun run = begin(job, row);
      run.drive_sha256 = *hash;
      auto figures = measure(row, folder, job.seed);
      if (stop_) return;
      if (figures) run.figures = std::move(figures).value();
      if (!figures) run.figures.failure = figures.error().message;
      add_peers(row, folder, run);
      done_(std::move(run));
    }
  }

 private:
  static MatrixRun begin(const MatrixJob& job, const MatrixRow& row) {
    MatrixRun run;
    run.row = row.name;
    run.number = job.number;
    run.seed = job.seed;
    run.bound_percent = row.bound_percent;
    return run;
  }

  void fail_all(const MatrixJob& job, const Error& error) const {
    for (const MatrixRow& row : job.rows) {
      if (stop_) return;
      MatrixRun run = begin(job, row);
      run.figures.failure = error.message;
      done_(std::move(run));
    }
  }

  [[nodiscard]] Result<RunFigures> measure(const MatrixRow& row, const fs::path& drive,
                                           std::uint64_t seed) const {
    if (!has_faults(row.faults)) return replay_and_measure(row, drive);
    const ScratchFolder mangled(options_.work / run_id(row, seed));
    mangle::Options options{drive.string(), mangled.path().string(), row.faults};
    options.faults.seed = seed;
    const auto summary = mangle::mangle(options);
    if (!summary) return summary.error();
    return replay_and_measure(row, mangled.path());
  }

  [[nodiscard]] Result<RunFigures> replay_and_measure(const MatrixRow& row, const fs::path& drive) const {
    const auto files = daemon::find_replay_files({drive.string()});
    if (!files) return files.error();
    std::vector<std::string> overrides = options_.overrides;
    // One thread, so that its CPU time is the scan's; the trajectory does not depend on the number.
    overrides.emplace_back("odometry.threads=1");
    if (!row.imu) overrides.emplace_back("imu.enabled=false");
    const auto config = recording_config(*files, overrides);
    if (!config) return config.error();
    const auto run = replay(*files, *config, thread_cpu_ns, {}, &stop_);
    if (!run) return run.error();
    const auto truth = read_trajectory((drive / "truth.tum").string());
    if (!truth) return truth.error();
    return measure_run(run->results, *truth);
  }

  void add_peers(const MatrixRow& row, const fs::path& drive, MatrixRun& run) const {
    for (const auto& [name, folder] : options_.peers) {
      const auto estimate = read_trajectory((folder / (run_id(row, run.seed) + ".tum")).string());
      const auto truth = read_trajectory((drive / "truth.tum").string());
      RunFigures& figures = run.peers[name];
      if (!estimate || !truth) {
        figures.failure = !estimate ? estimate.error().message : truth.error().message;
      } else if (estimate->format != TrajectoryFormat::kTum) {
        figures.failure = estimate->path + ": is no TUM file";
      } else {
        figures = measure_poses(check_poses(*estimate, *truth));
      }
    }
  }

  const RunnerOptions& options_;
  const std::atomic<bool>& stop_;
  const std::function<void(MatrixRun)>& done_;
};

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

std::vector<MatrixJob> remaining_jobs(std::vector<MatrixJob> jobs, const MatrixResult& earlier,
                                      std::vector<MatrixRun>& kept) {
  for (MatrixJob& job : jobs) {
    std::erase_if(job.rows, [&](const MatrixRow& row) {
      const auto run = std::find_if(earlier.runs.begin(), earlier.runs.end(), [&](const MatrixRun& r) {
        return r.row == row.name && r.seed == job.seed;
      });
      if (run == earlier.runs.end()) return false;
      kept.push_back(*run);
      return true;
    });
  }
  std::erase_if(jobs, [](const MatrixJob& job) { return job.rows.empty(); });
  return jobs;
}

std::size_t count_runs(const std::vector<MatrixJob>& jobs) {
  std::size_t runs = 0;
  for (const MatrixJob& job : jobs) runs += job.rows.size();
  return runs;
}

std::string drive_id(const DriveSpec& drive, std::uint64_t seed) {
  return slug(drive.name) + "_" + std::to_string(seed);
}

std::string run_id(const MatrixRow& row, std::uint64_t seed) {
  return slug(row.name) + "_" + std::to_string(seed);
}

void run_jobs(const std::vector<MatrixJob>& jobs, const RunnerOptions& options, const std::atomic<bool>& stop,
              const std::function<void(MatrixRun)>& done) {
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  const std::function<void(MatrixRun)> done_alone = [&](MatrixRun run) {
    const std::lock_guard<std::mutex> lock(mutex);
    done(std::move(run));
  };
  const auto work = [&] {
    JobRunner runner(options, stop, done_alone);
    for (std::size_t i = next++; i < jobs.size() && !stop; i = next++) runner.run(jobs[i]);
  };
  std::vector<std::jthread> threads;
  for (std::size_t i = 0; i < std::min(options.jobs, jobs.size()); ++i) threads.emplace_back(work);
}

}  // namespace nilio::tools::bench
