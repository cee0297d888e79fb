#include "tools/bench/matrix/run_figures.hpp"

#include "tools/bench/odometry/consistency.hpp"
#include "tools/evaluate/metrics.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nilio::tools::bench {

namespace {

using core::OdometryResult;
using core::SE3;
using core::TrackingState;

constexpr core::Duration kMaxTruthGap = core::Duration::from_milliseconds(200.0);
constexpr core::Duration kWindow = core::Duration::from_milliseconds(1000.0);
// A pose after a gap answers for at most so much time.
constexpr double kMaxPoseSeconds = 1.0;
constexpr double kSilentErrorM = 0.10;
constexpr double kSilentErrorShare = 0.02;
constexpr double kSilentErrorRad = 1.0 * std::numbers::pi / 180.0;
constexpr double kNeesPeriodS = 5.0;
constexpr double kMinPathM = 10.0;
constexpr std::size_t kSegmentStep = 5;

std::optional<SE3> true_pose(const Trajectory& truth, core::Time stamp) {
  const auto pose = interpolate_pose(truth, stamp, kMaxTruthGap);
  if (!pose) return std::nullopt;
  return se3_of(*pose);
}

/// The last pose at least `kWindow` before `poses[i]`, or the first one.
std::size_t window_begin(std::span<const CheckedPose> poses, std::size_t i) {
  std::size_t j = i;
  while (j > 0 && poses[i].stamp - poses[j].stamp < kWindow) --j;
  return j;
}

bool motion_is_wrong(const CheckedPose& from, const CheckedPose& to) {
  const SE3 true_motion = from.truth->inverse() * *to.truth;
  const SE3 error = true_motion.inverse() * (from.estimate.inverse() * to.estimate);
  const double allowed_m = kSilentErrorM + kSilentErrorShare * true_motion.translation.norm();
  return error.translation.norm() > allowed_m || core::so3_log(error.rotation).norm() > kSilentErrorRad;
}

evaluate::PosePairs pairs_of(std::span<const CheckedPose> poses) {
  evaluate::PosePairs pairs;
  for (const CheckedPose& pose : poses) {
    if (!pose.truth) continue;
    pairs.truth.emplace_back(pose.truth->matrix());
    pairs.estimate.emplace_back(pose.estimate.matrix());
  }
  return pairs;
}

/// Drift, path, RPE.
void measure_accuracy_of(const evaluate::PosePairs& pairs, RunFigures& figures) {
  const evaluate::EvaluationOptions options;
  const evaluate::Evaluation evaluation = evaluate::evaluate(pairs, options);
  figures.path_m = evaluation.truth_length_m;
  figures.rpe_m = evaluation.relative.translation_m.rmse;
  for (const evaluate::AbsoluteError& absolute : evaluation.absolute) {
    if (absolute.alignment == evaluate::Alignment::kOrigin) figures.end_error_m = absolute.end_translation_m;
  }
  const auto segments = evaluate::segment_errors(pairs, options.short_segment_lengths_m, kSegmentStep);
  figures.drift_percent = segments ? segments->all.translation_percent
                                   : 100.0 * figures.end_error_m / std::max(figures.path_m, kMinPathM);
}

/// One value every five seconds, so that the values are nearly independent.
void measure_nees(std::span<const OdometryResult> results, std::span<const CheckedPose> poses,
                  RunFigures& figures) {
  double sum = 0.0;
  std::optional<core::Time> last;
  for (std::size_t i = 0; i < results.size(); ++i) {
    if (last && (poses[i].stamp - *last).seconds() < kNeesPeriodS) continue;
    const std::size_t j = window_begin(poses, i);
    const bool usable = j < i && poses[i].stamp - poses[j].stamp >= kWindow && poses[i].truth &&
                        poses[j].truth && is_registered(results[i]) && is_registered(results[j]);
    if (!usable) continue;
    sum += motion_nees(results[j], *poses[j].truth, results[i], *poses[i].truth);
    ++figures.nees_count;
    last = poses[i].stamp;
  }
  if (figures.nees_count > 0) figures.nees = sum / static_cast<double>(figures.nees_count);
}

void measure_drift_nees(std::span<const OdometryResult> results, std::span<const CheckedPose> poses,
                        RunFigures& figures) {
  const auto has_truth = [](const CheckedPose& pose) { return pose.truth.has_value(); };
  const auto first =
      static_cast<std::size_t>(std::find_if(poses.begin(), poses.end(), has_truth) - poses.begin());
  for (std::size_t i = results.size(); i-- > first + 1;) {
    if (!poses[i].truth || !is_registered(results[i])) continue;
    figures.drift_nees = drift_nees(results[first], *poses[first].truth, results[i], *poses[i].truth);
    return;
  }
}

double cpu_ms(const OdometryResult& result) {
  return 1e-6 * static_cast<double>(result.stage_time_ns(core::OdometryStage::kMapped) -
                                    result.stage_time_ns(core::OdometryStage::kStarted));
}

}  // namespace

bool is_success(const RunFigures& figures, double bound_percent) {
  return describe_failure(figures, bound_percent).empty();
}

std::string describe_failure(const RunFigures& figures, double bound_percent) {
  if (!figures.failure.empty()) return "not run";
  if (figures.silent_error_s > 0.0) return "silent error";
  if (!(figures.drift_percent <= bound_percent))
    return figures.lost > 0 || !figures.ends_tracking ? "lost" : "drift";
  return "";
}

std::vector<CheckedPose> check_poses(std::span<const OdometryResult> results, const Trajectory& truth) {
  std::vector<CheckedPose> poses;
  for (const OdometryResult& result : results) {
    poses.push_back({result.scan_end, result.T_odom_base, true_pose(truth, result.scan_end),
                     result.state == TrackingState::kTracking});
  }
  return poses;
}

std::vector<CheckedPose> check_poses(const Trajectory& estimate, const Trajectory& truth) {
  std::vector<CheckedPose> poses;
  for (std::size_t i = 0; i < estimate.poses.size(); ++i)
    poses.push_back(
        {estimate.stamps[i], se3_of(estimate.poses[i]), true_pose(truth, estimate.stamps[i]), true});
  return poses;
}

double silent_error_seconds(std::span<const CheckedPose> poses) {
  double seconds = 0.0;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const std::size_t j = window_begin(poses, i);
    if (!poses[i].truth || !poses[j].truth || !poses[i].is_tracking || !poses[j].is_tracking) continue;
    if (motion_is_wrong(poses[j], poses[i]))
      seconds += std::min(kMaxPoseSeconds, (poses[i].stamp - poses[i - 1].stamp).seconds());
  }
  return seconds;
}

double longest_recovery_seconds(std::span<const CheckedPose> poses) {
  const auto is_tracking = [](const CheckedPose& pose) { return pose.is_tracking; };
  // Before the first tracking pose nothing was lost.
  auto pose = std::find_if(poses.begin(), poses.end(), is_tracking);
  double longest = 0.0;
  while (pose != poses.end()) {
    const auto lost = std::find_if_not(pose, poses.end(), is_tracking);
    if (lost == poses.end()) break;
    pose = std::find_if(lost, poses.end(), is_tracking);
    const core::Time until = pose != poses.end() ? pose->stamp : poses.back().stamp;
    longest = std::max(longest, (until - lost->stamp).seconds());
  }
  return longest;
}

RunFigures measure_poses(std::span<const CheckedPose> poses) {
  RunFigures figures;
  const evaluate::PosePairs pairs = pairs_of(poses);
  if (pairs.truth.size() < 2) {
    figures.failure = "fewer than two poses within the time of the truth";
    return figures;
  }
  measure_accuracy_of(pairs, figures);
  if (!std::isfinite(figures.drift_percent + figures.rpe_m + figures.end_error_m)) {
    figures.failure = "poses that are not finite";
    return figures;
  }
  figures.poses = poses.size();
  figures.silent_error_s = silent_error_seconds(poses);
  figures.recovery_s = longest_recovery_seconds(poses);
  figures.ends_tracking = poses.back().is_tracking;
  return figures;
}

RunFigures measure_run(std::span<const OdometryResult> results, const Trajectory& truth) {
  const std::vector<CheckedPose> poses = check_poses(results, truth);
  RunFigures figures = measure_poses(poses);
  if (!figures.failure.empty()) return figures;
  measure_nees(results, poses, figures);
  measure_drift_nees(results, poses, figures);
  for (const OdometryResult& result : results) {
    figures.tracking += result.state == TrackingState::kTracking ? 1 : 0;
    figures.degraded += result.state == TrackingState::kDegraded ? 1 : 0;
    figures.lost += result.state == TrackingState::kLost ? 1 : 0;
    figures.cpu_ms += cpu_ms(result) / static_cast<double>(results.size());
  }
  return figures;
}

}  // namespace nilio::tools::bench
