#include "tools/bench/odometry/measure.hpp"

#include "nilio/core/clock.hpp"

#include "tools/bench/common/memory_use.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>

namespace nilio::tools::bench {

namespace {

using core::Error;
using core::OdometryResult;
using core::OdometryStage;
using core::Result;

std::int64_t thread_cpu_ns() { return clock_ns(CLOCK_THREAD_CPUTIME_ID); }
/// CPU time of all threads: the registration's workers and those that read the recording.
std::int64_t process_cpu_ns() { return clock_ns(CLOCK_PROCESS_CPUTIME_ID); }

std::int64_t ticks(const OdometryResult& result, OdometryStage from, OdometryStage to) {
  return result.stage_time_ns(to) - result.stage_time_ns(from);
}

constexpr std::array<std::pair<OdometryStage, OdometryStage>, kStages> kStageEnds = {{
    {OdometryStage::kStarted, OdometryStage::kFiltered},
    {OdometryStage::kFiltered, OdometryStage::kCoarse},
    {OdometryStage::kCoarse, OdometryStage::kFine},
    {OdometryStage::kFine, OdometryStage::kMapped},
}};

/// Minimum time of each scan and stage over several runs.
class MinimumTimes {
 public:
  void add(const std::vector<OdometryResult>& results) {
    total_.resize(results.size(), std::numeric_limits<double>::infinity());
    with_feed_.resize(results.size(), std::numeric_limits<double>::infinity());
    for (auto& stage : stages_) stage.resize(results.size(), std::numeric_limits<double>::infinity());
    for (std::size_t i = 0; i < results.size(); ++i) {
      const auto keep = [&](std::vector<double>& minimum, OdometryStage from, OdometryStage to) {
        minimum[i] = std::min(minimum[i], static_cast<double>(ticks(results[i], from, to)) * 1e-6);
      };
      keep(total_, OdometryStage::kStarted, OdometryStage::kMapped);
      const std::int64_t since = i == 0 ? start_of(results[i]) : end_of(results[i - 1]);
      with_feed_[i] = std::min(with_feed_[i], static_cast<double>(end_of(results[i]) - since) * 1e-6);
      for (std::size_t s = 0; s < kStages; ++s) keep(stages_[s], kStageEnds[s].first, kStageEnds[s].second);
    }
  }
  [[nodiscard]] StageTimes times() const {
    StageTimes times;
    times.total = percentiles_of(total_);
    times.with_feed = percentiles_of(with_feed_);
    times.per_scan = total_;
    for (std::size_t s = 0; s < kStages; ++s) times.stages[s] = percentiles_of(stages_[s]);
    return times;
  }

 private:
  static std::int64_t start_of(const OdometryResult& result) {
    return result.stage_time_ns(OdometryStage::kStarted);
  }
  static std::int64_t end_of(const OdometryResult& result) {
    return result.stage_time_ns(OdometryStage::kMapped);
  }

  std::vector<double> total_;
  std::vector<double> with_feed_;
  std::array<std::vector<double>, kStages> stages_;
};

WorkCounts count_work(const BenchRun& run) {
  WorkCounts work;
  work.scans = run.results.size();
  work.with_imu = run.scans_with_imu;
  const double share = 1.0 / static_cast<double>(run.results.size());
  for (const OdometryResult& result : run.results) {
    work.predicted += result.predicted ? 1 : 0;
    work.passes += share * result.passes;
    work.coarse_iterations += share * result.coarse_iterations;
    work.fine_iterations += share * result.fine_iterations;
    work.points += share * result.points;
    work.points_filtered += share * result.points_filtered;
    work.points_used += share * result.points_used;
    work.correspondences += share * result.correspondences;
    work.map_voxels += share * result.map_voxels;
  }
  return work;
}

void count_allocations(const BenchRun& run, Measurement& measurement) {
  std::int64_t later = 0;
  for (std::size_t i = 0; i < run.results.size(); ++i) {
    const std::int64_t count = ticks(run.results[i], OdometryStage::kStarted, OdometryStage::kMapped);
    (i < kWarmUpScans ? measurement.allocations_warming_up : later) += count;
  }
  if (run.results.size() > kWarmUpScans) {
    measurement.allocations_per_scan =
        static_cast<double>(later) / static_cast<double>(run.results.size() - kWarmUpScans);
  }
}

}  // namespace

Result<Accuracy> measure_accuracy(const Trajectory& truth, const Trajectory& estimate) {
  const auto pairs = evaluate::associate(truth, estimate, {});
  if (!pairs) return pairs.error();
  const evaluate::EvaluationOptions options;
  const evaluate::Evaluation evaluation = evaluate::evaluate(*pairs, options);
  Accuracy accuracy;
  constexpr std::size_t near_step = 5;
  constexpr std::size_t far_step = 10;
  if (const auto near = evaluate::segment_errors(*pairs, options.short_segment_lengths_m, near_step))
    accuracy.near = near->all;
  if (const auto far = evaluate::segment_errors(*pairs, options.segment_lengths_m, far_step))
    accuracy.far = far->all;
  for (const evaluate::AbsoluteError& absolute : evaluation.absolute) {
    if (absolute.alignment == evaluate::Alignment::kSe3) accuracy.ape_m = absolute.errors.translation_m.rmse;
    if (absolute.alignment == evaluate::Alignment::kOrigin && evaluation.truth_length_m > 0.0)
      accuracy.end_drift_percent = 100.0 * absolute.end_translation_m / evaluation.truth_length_m;
  }
  accuracy.rpe_m = evaluation.relative.translation_m.rmse;
  accuracy.rpe_deg = evaluation.relative.rotation_deg.rmse;
  accuracy.truth_length_m = evaluation.truth_length_m;
  accuracy.estimate_length_m = evaluation.estimate_length_m;
  return accuracy;
}

std::string label_of(const Measurement& measurement) {
  if (measurement.threads == 1) return measurement.name;
  return measurement.name + ", " + std::to_string(measurement.threads) + " threads";
}

const char* stage_name(std::size_t stage) {
  static constexpr std::array<const char*, kStages> kNames = {"filter", "coarse", "fine", "map"};
  return kNames[stage];
}

Result<Measurement> measure_odometry(const BenchDataset& dataset, const std::string& name,
                                     const std::vector<std::string>& overrides, int repeats) {
  const Result<daemon::Config> config = bench_config(dataset, overrides);
  if (!config) return config.error();
  Measurement measurement;
  measurement.name = name;
  measurement.threads = config->odometry.threads;
  MinimumTimes wall;
  MinimumTimes cpu;
  const auto run_once = [&](core::Odometry::ClockFunction clock) -> Result<BenchRun> {
    Result<BenchRun> run = run_odometry(dataset, *config, clock, {});
    if (!run) return run.error();
    if (measurement.sha256.empty()) measurement.sha256 = run->sha256;
    if (run->sha256 != measurement.sha256)
      return Error{dataset.name + ", " + name + ": two runs gave different trajectories (SHA-256 " +
                   measurement.sha256 + " and " + run->sha256 + ") - please report this"};
    return run;
  };
  for (int repeat = 0; repeat < repeats; ++repeat) {
    Result<BenchRun> timed = run_once(monotonic_ns);
    if (!timed) return timed.error();
    wall.add(timed->results);
    const Result<BenchRun> charged = run_once(measurement.threads == 1 ? thread_cpu_ns : process_cpu_ns);
    if (!charged) return charged.error();
    cpu.add(charged->results);
    if (repeat > 0) continue;
    measurement.work = count_work(*timed);
    measurement.consistency = evaluate_consistency(dataset.truth, timed->results);
    measurement.peak_resident_bytes = timed->peak_resident_bytes;
    measurement.resident_before_bytes = timed->resident_before_bytes;
    measurement.trajectory = std::move(timed->trajectory);
    const Result<BenchRun> counted = run_once(allocation_count);
    if (!counted) return counted.error();
    count_allocations(*counted, measurement);
  }
  measurement.wall = wall.times();
  measurement.cpu = cpu.times();
  const Result<Accuracy> accuracy = measure_accuracy(dataset.truth, measurement.trajectory);
  if (!accuracy) return Error{dataset.name + ": " + accuracy.error().message};
  measurement.accuracy = *accuracy;
  return measurement;
}

}  // namespace nilio::tools::bench
