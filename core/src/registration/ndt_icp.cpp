#include "core/src/odometry_impl.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

// Scale of the robust kernel in standard deviations of the prediction.
constexpr double kKernelSigmas = 0.5;
// A pass is repeated if the end of the sweep moves by more than registration resolves.
constexpr double kMotionEpsilonMetres = 2.5e-3;
constexpr double kMotionEpsilonRadians = 2.5e-4;
// Points times iterations of ICP, about 0.2 ms, from which a second thread pays.
constexpr std::size_t kMinSharedWork = 4000;
constexpr double kCoarseTriggerErrorMetres = 0.5;
// Error of the mean of a non-planar voxel.
constexpr double kVoxelMeanDeviation = 0.1;
constexpr double kCoarseTriggerGap = 1.5;

/// Minimum prior variance: the next scan may begin a gentle manoeuvre of 1 m/s^2, or the same displacement at
/// 30 m by rotation, over 0.1 s.
Vector6 min_prediction_error_variance() {
  constexpr double kMinMetres = 0.01;
  Vector6 square;
  square << Vector3::Constant(kMinMetres * kMinMetres),
      Vector3::Constant(kMinMetres * kMinMetres / (kErrorLeverMetres * kErrorLeverMetres));
  return square;
}

/// Weight of Gaussians beside a prior from the accelerometer. All points of a voxel share the error of its
/// mean, which their number does not reduce: a better prediction is not drawn to it.
double gaussian_weight(const std::optional<PosePrior>& prior) {
  if (!prior || !prior->translation_is_gaussian) return 1.0;
  const double variance = prior->variance.head<3>().maxCoeff();
  return variance / (variance + kVoxelMeanDeviation * kVoxelMeanDeviation);
}

/// Whether the coarse pose is usable, also if the budget ended before convergence.
bool has_found_pose(const RegistrationResult& coarse) {
  return coarse.iterations > 0 &&
         (coarse.stop_reason == StopReason::kBudget || coarse.stop_reason == StopReason::kConverged ||
          coarse.stop_reason == StopReason::kMaxIterations);
}

}  // namespace

void Odometry::State::select_points(const SE3& T_guess) {
  motion.deskew(sweep, deskewed);
  const std::size_t target = budget.choose_registration_points(config.registration_points, coarse_is_due());
  const SelectionConfig selection_config{target, kCoarseVoxelMetres, PlaneMetric{}.max_planarity};
  selector.select(planes, filter, deskewed, T_guess, selection_config, selection);
  selected_sweep.clear();
  for (const std::uint32_t index : selection) selected_sweep.push_back(sweep[index]);
  sample_evenly(deskewed, kCoarsePoints, coarse_points);
}

bool Odometry::State::coarse_is_due() const {
  if (!method.coarse) return false;
  if (config.coarse == CoarsePolicy::kAlways || coarse_scans_left > 0 || failures > 0) return true;
  return prediction_error_m > kCoarseTriggerErrorMetres || is_gap(motion_prior.span_s());
}

bool Odometry::State::is_gap(double span_s) const { return span_s > kCoarseTriggerGap * period_s; }

PlaneMetric plane_metric(double sigma_m) {
  PlaneMetric metric;
  metric.gate_m = kGateSigmas * sigma_m;
  metric.kernel_scale_m = kKernelSigmas * sigma_m;
  return metric;
}

RegistrationResult Odometry::State::register_fine(const std::vector<Eigen::Vector3f>& points,
                                                  const SE3& T_guess, const PlaneMetric& metric,
                                                  const std::optional<PosePrior>& prior,
                                                  OdometryResult& result) {
  SolverOptions options;
  options.max_iterations = config.max_fine_iterations;
  options.prior = prior;
  options.budget = &budget;
  const RegistrationMaps maps{&planes, &coarse_map, point_map ? &*point_map : nullptr};
  const RegistrationResult fine = method.refine(maps, points, T_guess, metric, options);
  result.fine_iterations += fine.iterations;
  return fine;
}

RegistrationResult Odometry::State::register_coarse(OdometryResult& result) {
  const RegistrationResult coarse = register_coarsely(coarse_map, coarse_points, registration.T_map_moving,
                                                      config.max_coarse_iterations, &budget);
  result.coarse_iterations += coarse.iterations;
  if (has_found_pose(coarse)) registration.T_map_moving = coarse.T_map_moving;
  return coarse;
}

/// The prior of the registration; none while initialising, after a gap or for a relocalised pose.
std::optional<PosePrior> Odometry::State::pose_prior() const {
  if (relocalized ||
      (!applies_zero_velocity_update() && (scans < kInitialScans || is_gap(motion_prior.span_s()))))
    return std::nullopt;
  PosePrior prior{T_predicted, prediction_error_variance.cwiseMax(min_prediction_error_variance())};
  if (motion_prior.acceleration) {
    prior.variance.head<3>() = motion_filter.position_variance(T_predicted.rotation.toRotationMatrix());
    prior.translation_is_gaussian = true;
  }
  return prior;
}

/// Updates the motion and returns the resulting correction of the end of the sweep.
SE3 Odometry::State::refine_motion(SE3& T_map_end) {
  const SE3 T_registered = T_map_end;
  const SE3 T_previous_end = T_map_base.inverse() * T_registered;
  measured_twist = motion.measure(T_previous_end, last_T_middle_end, last_sweep_s);
  // While initialising there is no prediction to combine with.
  const bool initial = scans < kInitialScans;
  const Vector6 wanted =
      initial ? measured_twist : twist.correct(measured_twist, registration.observability, measured_step());
  T_map_end = T_map_base * motion.refine(T_previous_end, wanted);
  deskew_rate = motion.mean_angular_velocity();
  return T_registered.inverse() * T_map_end;
}

/// The pose of NDT where ICP failed or had no time, with the inliers and agreement of the plane map.
RegistrationResult Odometry::State::kept_coarse(RegistrationResult coarse, const PlaneMetric& metric) {
  if (has_no_time()) coarse.stop_reason = StopReason::kBudget;
  const NormalEquations agreeing = plane_equations(planes, selected, coarse.T_map_moving, metric);
  coarse.equations.inliers = agreeing.inliers;
  coarse.equations.agreement = agreeing.agreement;
  return coarse;
}

void Odometry::State::register_points(bool coarse, PlaneMetric metric, OdometryResult& result) {
  const std::optional<PosePrior> prior = pose_prior();
  metric.gaussian_weight = gaussian_weight(prior);
  const bool by_accelerometer = motion_prior.is_stationary || (prior && prior->translation_is_gaussian);
  RegistrationResult by_coarse;
  for (int pass = 0; pass < config.max_passes; ++pass) {
    if (pass > 0 && !budget.allows(WorkKind::kIcp, selected_sweep.size())) {
      registration.stop_reason = StopReason::kBudget;
      return;
    }
    motion.deskew(selected_sweep, selected);
    registered_points = selected.size();
    if (coarse && pass == 0) by_coarse = register_coarse(result);
    if (pass == 0) stamp(result, OdometryStage::kCoarse);
    registration = register_fine(selected, registration.T_map_moving, metric, prior, result);
    // ICP with less than half of NDT's correspondences is a minimum among few points; NDT also follows
    // moving objects, so not beside a prior from the accelerometer.
    const bool has_few =
        !by_accelerometer && 2 * registration.equations.correspondences < by_coarse.equations.correspondences;
    const bool has_failed = !has_pose() || has_few;
    if (has_failed && has_found_pose(by_coarse)) registration = kept_coarse(by_coarse, metric);
    ++result.passes;
    if (has_no_time()) return;
    if (!registration.T_map_moving.is_finite()) return;
    if (relocalized) {
      if (registration.stop_reason != StopReason::kMaxIterations) return;
      continue;
    }
    const SE3 change = refine_motion(registration.T_map_moving);
    const bool settled = change.translation.norm() < kMotionEpsilonMetres &&
                         so3_log(change.rotation).norm() < kMotionEpsilonRadians;
    if (settled || motion_compensated) return;
  }
}

/// Arena of this registration; results do not depend on it.
tbb::task_arena& Odometry::State::registration_arena() {
  const bool is_little = scans > 1 && !coarse_is_due() && failures == 0 &&
                         last_fine_iterations * selected_sweep.size() < kMinSharedWork;
  return is_little ? single_thread_arena : arena;
}

void Odometry::State::register_sweep(OdometryResult& result) {
  registration = {};
  registration.T_map_moving = T_predicted;
  coarse_was_due = coarse_is_due();
  if (scans == 1) {
    find_initial_velocity(result);
    twist.reset(measured_twist);
    if (!motion_compensated) rebuild_first_map();
    T_predicted = registration.T_map_moving;
    select_points(T_predicted);
  }
  register_points(coarse_was_due, plane_metric(sigma_m), result);
  count_inliers(result);
  if (scans < kInitialScans || sweep.empty() || has_no_time() || !is_doubtful()) return;
  compare_hypotheses(result);
}

/// The budget ended before the first iteration: the registration is no evidence.
bool Odometry::State::has_no_time() const {
  return registration.stop_reason == StopReason::kBudget && registration.iterations == 0;
}

DegradationLevel Odometry::State::degradation_level_of(const OdometryResult& result) const {
  if (!budget.was_short()) return DegradationLevel::kFull;
  const bool has_coarse = result.coarse_iterations > 0;
  if (result.fine_iterations == 0)
    return has_coarse ? DegradationLevel::kNdtOnly : DegradationLevel::kPredictionOnly;
  return method.coarse && coarse_was_due && !has_coarse ? DegradationLevel::kIcpOnly
                                                        : DegradationLevel::kFewerPoints;
}

void Odometry::State::count_inliers(OdometryResult& result) const {
  result.points_used = static_cast<std::uint32_t>(registered_points);
  result.correspondences = registration.equations.correspondences;
  result.inlier_ratio = registered_points == 0 ? 0.0
                                               : static_cast<double>(registration.equations.inliers) /
                                                     static_cast<double>(registered_points);
}

/// Motion between the midpoints of two sweeps, which deskewing errors hardly affect.
RegisteredMotion Odometry::State::registered_motion() const {
  const MotionModel::Span& span = motion_prior.span;
  return {span.previous - Duration::from_seconds(0.5 * last_sweep_s),
          span.end - Duration::from_seconds(0.5 * motion.sweep_s()), T_map_base * last_T_middle_end.inverse(),
          registration.T_map_moving * motion.T_middle_end().inverse()};
}

/// A contradicted gyro has already distorted the scan by deskewing: registers it again without the gyro.
void Odometry::State::reconsider_imu(OdometryResult& result) {
  if (!motion_prior.imu_used || relocalized || !is_plausible() ||
      !monitor.contradicts(imu, gyro_bias, registered_motion()))
    return;
  monitor.demote();
  motion_prior.imu_used = false;
  motion_prior.acceleration = imu_acceleration(motion_prior);
  result.imu_used = false;
  Vector6 expected = expected_twist(motion_prior);
  expected.tail<3>() = monitor.registered_rate();
  set_rotation(motion_prior.span, false, expected, motion);
  T_predicted = T_map_base * motion.predict(expected.head<3>());
  select_points(T_predicted);
  register_sweep(result);
}

}  // namespace nilio::core
