#include "core/src/registration/ndt_icp.hpp"

#include "core/src/prefault.hpp"
#include "core/src/registration/gauss_newton.hpp"

#include <algorithm>

namespace nilio::core {

namespace {

constexpr std::size_t kCoarsePoints = 800;
// Scale of the robust kernel in standard deviations of a guess that is as bad for every point.
constexpr double kKernelSigmas = 0.5;
constexpr int kMaxWidenings = 3;
// Error of the mean of a non-planar voxel.
constexpr double kVoxelMeanDeviation = 0.1;
// Convergence thresholds within the basin of ICP; the best of several hypotheses is registered again.
constexpr CoarseEpsilon kRoughEpsilon{0.1, 0.01};

/// Weight of Gaussians beside a prior. All points of a voxel share the error of its mean, which their number
/// does not reduce: a better prediction is not drawn to it.
double gaussian_weight(const std::optional<PosePrior>& prior) {
  if (!prior) return 1.0;
  const double variance = prior->covariance.topLeftCorner<3, 3>().trace();
  return variance / (variance + kVoxelMeanDeviation * kVoxelMeanDeviation);
}

}  // namespace

bool has_found_pose(const RegistrationResult& registration) {
  return registration.iterations > 0 && (registration.stop_reason == StopReason::kBudget ||
                                         registration.stop_reason == StopReason::kConverged ||
                                         registration.stop_reason == StopReason::kMaxIterations);
}

PlaneMetric plane_metric(double sigma_m) {
  PlaneMetric metric;
  metric.gate_m = kGateSigmas * sigma_m;
  metric.kernel_scale_m = kKernelSigmas * sigma_m;
  return metric;
}

PlaneMetric metric_of(const MotionFilter& prediction) {
  PlaneMetric metric = plane_metric(kMinSigmaMetres);
  metric.guess_covariance = prediction.pose_covariance();
  return metric;
}

void Alignment::count(OdometryResult& result) const {
  result.points_used = static_cast<std::uint32_t>(points);
  result.correspondences = registration.equations.correspondences;
  result.inlier_ratio =
      points == 0 ? 0.0 : static_cast<double>(registration.equations.inliers) / static_cast<double>(points);
}

NdtIcp::NdtIcp(const OdometryConfig& config, ComputeBudget& budget, StageClock clock)
    : method_(info_of(config.registration)),
      budget_(budget),
      clock_(clock),
      max_points_(config.registration_points),
      max_passes_(config.max_passes),
      max_coarse_iterations_(config.max_coarse_iterations),
      max_fine_iterations_(config.max_fine_iterations),
      sampler_(config.max_filtered_points),
      downsampler_(config.max_filtered_points) {
  prefault(config.max_filtered_points, deskewed_);
  prefault(max_points_, selection_, selected_sweep_, selected_, point_times_);
  prefault(kCoarsePoints, coarse_points_);
}

void NdtIcp::select(const std::vector<SweepPoint>& sweep, const SweepMotion& motion, const LocalMap& map,
                    const SE3& T_map_guess, bool coarse) {
  motion.deskew(sweep, deskewed_);
  const std::size_t target = budget_.choose_registration_points(max_points_, coarse);
  const SelectionConfig selection_config{target, kCoarseVoxelMetres, PlaneMetric{}.max_planarity};
  sampler_.select(map.planes(), downsampler_, deskewed_, T_map_guess, selection_config, selection_);
  selected_sweep_.clear();
  for (const std::uint32_t index : selection_) selected_sweep_.push_back(sweep[index]);
  const std::size_t wanted = std::min(target, sweep.size());
  known_share_ = wanted == 0 ? 0.0 : static_cast<double>(selection_.size()) / static_cast<double>(wanted);
  sample_evenly(deskewed_, kCoarsePoints, coarse_points_);
}

SolverOptions NdtIcp::solver_options() const {
  SolverOptions options;
  options.max_iterations = max_fine_iterations_;
  options.budget = &budget_;
  return options;
}

/// With the prediction as prior. Beside one that is known at all any correspondence counts, and none is
/// needed while the map begins, which may hold nothing of the scan yet.
SolverOptions NdtIcp::solver_options(const MotionEstimator& motion) const {
  SolverOptions options = solver_options();
  options.prior = {motion.T_predicted(), motion.filter().pose_covariance(),
                   motion.prior().inputs.measure_motion()};
  if (motion.deviation_m() < kMaxSigmaMetres) options.min_correspondences = motion.is_initialising() ? 0 : 1;
  return options;
}

RegistrationResult NdtIcp::register_fine(const LocalMap& map, std::span<const Eigen::Vector3f> points,
                                         const SE3& T_map_guess, const PlaneMetric& metric,
                                         const SolverOptions& options, OdometryResult& result) {
  const RegistrationMaps maps{&map.planes(), &map.gaussians(), map.points()};
  const RegistrationResult fine = method_.refine(maps, points, T_map_guess, metric, options);
  result.fine_iterations += fine.iterations;
  return fine;
}

RegistrationResult NdtIcp::register_coarse(const LocalMap& map, RegistrationResult& registration,
                                           OdometryResult& result) {
  const RegistrationResult coarse = register_coarsely(
      map.gaussians(), coarse_points_, registration.T_map_moving, max_coarse_iterations_, &budget_);
  result.coarse_iterations += coarse.iterations;
  if (has_found_pose(coarse)) registration.T_map_moving = coarse.T_map_moving;
  return coarse;
}

/// Twist of the sweep beside its pose: its points are seen one after the other.
SweepProblem NdtIcp::sweep_problem(const MotionEstimator& motion) {
  const auto half_s = static_cast<float>(0.5 * motion.prior().span.seconds());
  point_times_.clear();
  for (const SweepPoint& point : selected_sweep_) point_times_.push_back(point.time_s + half_s);
  const MotionFilter& filter = motion.filter();
  return {point_times_,
          motion.motion().middle_twist(),
          {motion.T_predicted(), filter.state().twist(), filter.motion_covariance()}};
}

/// The pose of NDT where ICP failed or had no time, with the inliers and agreement of the plane map.
RegistrationResult NdtIcp::kept_coarse(const LocalMap& map, RegistrationResult coarse,
                                       const PlaneMetric& metric, const SolverOptions& options,
                                       bool had_no_time) {
  if (had_no_time) {
    coarse.stop_reason = StopReason::kBudget;
  } else if (options.prior) {
    const RegistrationResult held = register_ndt(map.gaussians(), coarse_points_, coarse.T_map_moving,
                                                 std::span(kNdtKernelSchedule).last<1>(), options);
    if (held.iterations > 0) coarse = held;
  }
  const NormalEquations agreeing = plane_equations(map.planes(), selected_, coarse.T_map_moving, metric);
  coarse.equations.inliers = agreeing.inliers;
  coarse.equations.agreement = agreeing.agreement;
  return coarse;
}

/// Whether ICP meets less than half of the scene that NDT does: a minimum among few points. A map that begins
/// has few planes, so that ICP sees little of the scene; later the shares of both samples compare.
bool NdtIcp::has_few(const RegistrationResult& fine, const RegistrationResult& coarse,
                     const MotionEstimator& motion) const {
  const std::size_t of_fine = fine.equations.correspondences;
  const std::size_t of_coarse = coarse.equations.correspondences;
  if (motion.is_initialising()) return 2 * of_fine < of_coarse;
  return 2 * of_fine * coarse_points_.size() < of_coarse * selected_.size();
}

Alignment NdtIcp::align(const LocalMap& map, MotionEstimator& motion, const AlignmentStart& start,
                        OdometryResult& result) {
  const MotionPrior& about = motion.prior();
  const bool by_accelerometer = about.is_stationary || about.inputs.accelerometer;
  Alignment alignment;
  alignment.with_coarse = start.coarse;
  alignment.relocalized = start.relocalized;
  alignment.known_share = known_share_;
  RegistrationResult& registration = alignment.registration;
  registration.T_map_moving = start.T_map_guess;
  PlaneMetric metric = start.metric;
  RegistrationResult coarse;
  bool is_manoeuvring = false;
  int widenings = 0;
  for (int pass = 0; pass < max_passes_; ++pass) {
    if (pass > 0 && !budget_.allows(WorkKind::kIcp, selected_sweep_.size())) {
      registration.stop_reason = StopReason::kBudget;
      break;
    }
    SolverOptions options = start.relocalized ? solver_options() : solver_options(motion);
    metric.gaussian_weight = gaussian_weight(options.prior);
    motion.motion().deskew(selected_sweep_, selected_);
    alignment.points = selected_.size();
    if (start.coarse && pass == 0) coarse = register_coarse(map, registration, result);
    if (pass == 0) clock_.stamp(result, OdometryStage::kCoarse);
    const SweepProblem problem = is_manoeuvring ? sweep_problem(motion) : SweepProblem{};
    if (is_manoeuvring) options.sweep = &problem;
    registration = register_fine(map, selected_, registration.T_map_moving, metric, options, result);
    // NDT also follows moving objects: not beside a prior from the accelerometer.
    alignment.by_ndt =
        (!alignment.has_pose() || (!by_accelerometer && has_few(registration, coarse, motion))) &&
        has_found_pose(coarse);
    alignment.only_ndt = false;
    if (alignment.by_ndt) {
      // NDT follows moving objects where nothing holds it: an IMU, or the motion before a new map.
      const bool is_known = about.imu_covers || (motion.motion_goes_on() && motion.is_initialising());
      const SolverOptions held = is_known ? solver_options(motion) : solver_options();
      registration = kept_coarse(map, coarse, metric, held, alignment.had_no_time());
      alignment.only_ndt = !held.prior;
    }
    ++result.passes;
    if (alignment.had_no_time() || !alignment.pose().is_finite()) break;
    if (start.relocalized) {
      if (registration.stop_reason != StopReason::kMaxIterations) break;
      continue;
    }
    const bool is_settled = motion.follow(registration);
    // Over a gap the filter expects manoeuvres already.
    if (!about.is_known_gap && widenings < kMaxWidenings && motion.widen_for_manoeuvre(alignment.pose())) {
      metric = metric_of(motion.filter());
      is_manoeuvring = !about.inputs.gyro && !about.motion_compensated && !about.is_gap;
      ++widenings;
      --pass;
      static_cast<void>(motion.follow(registration));
      continue;
    }
    if (is_settled || about.motion_compensated) break;
  }
  return alignment;
}

RegistrationResult NdtIcp::register_roughly(const LocalMap& map, std::span<const Eigen::Vector3f> points,
                                            const SE3& T_map_hypothesis, double sigma_m,
                                            OdometryResult& result) {
  if (!method_.coarse)
    return register_fine(map, points, T_map_hypothesis, plane_metric(sigma_m), solver_options(), result);
  const RegistrationResult coarse = register_coarsely(map.gaussians(), points, T_map_hypothesis,
                                                      max_coarse_iterations_, &budget_, kRoughEpsilon);
  result.coarse_iterations += coarse.iterations;
  return coarse;
}

RegistrationResult NdtIcp::align_roughly(const LocalMap& map, std::span<const Eigen::Vector3f> points,
                                         const SE3& T_map_hypothesis, double sigma_m,
                                         OdometryResult& result) {
  const RegistrationResult rough = register_roughly(map, points, T_map_hypothesis, sigma_m, result);
  if (!method_.coarse) return rough;
  return register_fine(map, points, rough.T_map_moving, plane_metric(sigma_m), solver_options(), result);
}

void NdtIcp::add_residuals(const LocalMap& map, const MotionEstimator& motion, const Alignment& alignment,
                           const SE3& T_base_lidar, BeamCalibration& calibration) {
  const PlaneMetric metric;
  const double point_variance = metric.point_deviation_m * metric.point_deviation_m;
  const SE3 T_map_lidar = motion.filter().state().T_map_base * T_base_lidar;
  const Matrix3 R_map_lidar = T_map_lidar.rotation.toRotationMatrix();
  const SE3 T_lidar_base = T_base_lidar.inverse();
  motion.motion().deskew(selected_sweep_, selected_);
  for (std::size_t i = 0; i < selected_.size(); ++i) {
    const Vector3 p = T_lidar_base * selected_[i].cast<double>();
    const Vector3 q = T_map_lidar * p;
    const VoxelIndex index = map.planes().index_of(q);
    const GaussianVoxel* surface = map.planes().find(index);
    if (surface == nullptr || static_cast<double>(surface->planarity) > metric.max_planarity) continue;
    const Vector3 normal = surface->normal.cast<double>();
    const double distance_m = normal.dot(q - map.planes().corner_of(index) - surface->mean.cast<double>());
    const double square = distance_m * distance_m;
    if (square > kGateSigmas * kGateSigmas * point_variance) continue;
    const double root = point_variance / (point_variance + square);
    const double certainty = point_variance / (point_variance + static_cast<double>(surface->thickness));
    calibration.add(
        {selected_sweep_[i].beam, p, R_map_lidar.transpose() * normal, distance_m, root * root * certainty});
  }
  calibration.update(measurement_variance(alignment.registration.equations));
}

}  // namespace nilio::core
