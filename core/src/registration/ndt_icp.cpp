#include "core/src/odometry_impl.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

// Scale of the robust kernel in standard deviations of a guess that is as bad for every point.
constexpr double kKernelSigmas = 0.5;
// A pass is repeated if the end of the sweep moves by more than registration resolves.
constexpr double kMotionEpsilonMetres = 2.5e-3;
constexpr double kMotionEpsilonRadians = 2.5e-4;
// Points times iterations of ICP, about 0.2 ms, from which a second thread pays.
constexpr std::size_t kMinSharedWork = 4000;
constexpr double kCoarseTriggerErrorMetres = 0.5;
constexpr double kCoarseTriggerGap = 1.5;

constexpr int kMaxWidenings = 3;

// Velocities of a vehicle that is not stationary after all, m/s and rad/s.
constexpr double kWalkingSpeed = 2.0;

// Error of the mean of a non-planar voxel.
constexpr double kVoxelMeanDeviation = 0.1;

/// Weight of Gaussians beside a prior. All points of a voxel share the error of its mean, which their number
/// does not reduce: a better prediction is not drawn to it.
double gaussian_weight(const std::optional<PosePrior>& prior) {
  if (!prior) return 1.0;
  const double variance = prior->covariance.topLeftCorner<3, 3>().trace();
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
  const std::size_t wanted = std::min(target, sweep.size());
  known_share = wanted == 0 ? 0.0 : static_cast<double>(selection.size()) / static_cast<double>(wanted);
  sample_evenly(deskewed, kCoarsePoints, coarse_points);
}

bool Odometry::State::coarse_is_due() const {
  if (!method.coarse) return false;
  if (config.coarse == CoarsePolicy::kAlways || coarse_scans_left > 0 || failures > 0) return true;
  return std::max(prediction_error_m, sigma_m) > kCoarseTriggerErrorMetres || is_gap(motion_prior.span_s());
}

bool Odometry::State::is_gap(double span_s) const { return span_s > kCoarseTriggerGap * period_s; }

PlaneMetric Odometry::State::metric_of_prediction() const {
  PlaneMetric metric = plane_metric(kMinSigmaMetres);
  metric.guess_covariance = motion_filter.pose_covariance();
  return metric;
}

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
  const SweepProblem problem = prior && is_manoeuvring ? sweep_problem() : SweepProblem{};
  if (!problem.times_s.empty()) options.sweep = &problem;
  options.budget = &budget;
  const RegistrationMaps maps{&planes, &ndt_map, point_map ? &*point_map : nullptr};
  const RegistrationResult fine = method.refine(maps, points, T_guess, metric, options);
  result.fine_iterations += fine.iterations;
  return fine;
}

RegistrationResult Odometry::State::register_coarse(OdometryResult& result) {
  const RegistrationResult coarse = register_coarsely(ndt_map, coarse_points, registration.T_map_moving,
                                                      config.max_coarse_iterations, &budget);
  result.coarse_iterations += coarse.iterations;
  if (has_found_pose(coarse)) registration.T_map_moving = coarse.T_map_moving;
  return coarse;
}

/// The prior of the registration; none for a relocalised pose.
std::optional<PosePrior> Odometry::State::pose_prior() const {
  if (relocalized) return std::nullopt;
  return PosePrior{T_predicted, motion_filter.pose_covariance()};
}

/// Twist of the sweep beside its pose: its points are seen one after the other.
SweepProblem Odometry::State::sweep_problem() {
  const auto half_s = static_cast<float>(0.5 * motion_prior.span.seconds());
  point_times.clear();
  for (const SweepPoint& point : selected_sweep) point_times.push_back(point.time_s + half_s);
  return {point_times,
          motion.middle_twist(),
          {T_predicted, motion_filter.state().twist(), motion_filter.motion_covariance()}};
}

/// The motion follows the registered pose. Returns whether the end of the sweep moves by less than
/// registration resolves.
bool Odometry::State::refine_motion() {
  const SE3 T_middle_end = motion.T_middle_end();
  follow(registration.sweep_information.isZero()
             ? motion_filter.conditioned_on(registration.T_map_moving)
             : motion_filter.conditioned_on(registration.T_map_moving, registration.twist));
  const SE3 change = T_middle_end.inverse() * motion.T_middle_end();
  return change.translation.norm() < kMotionEpsilonMetres &&
         so3_log(change.rotation).norm() < kMotionEpsilonRadians;
}

/// The pose of NDT where ICP failed or had no time, beside an IMU with the prior, and with the inliers and
/// agreement of the plane map.
RegistrationResult Odometry::State::kept_coarse(RegistrationResult coarse, const PlaneMetric& metric,
                                                const std::optional<PosePrior>& prior) {
  if (has_no_time()) {
    coarse.stop_reason = StopReason::kBudget;
  } else if (prior && motion_prior.imu_covers) {
    SolverOptions options;
    options.max_iterations = config.max_fine_iterations;
    options.prior = prior;
    options.budget = &budget;
    const RegistrationResult held = register_ndt(ndt_map, coarse_points, coarse.T_map_moving,
                                                 std::span(kNdtKernelSchedule).last<1>(), options);
    if (held.iterations > 0) coarse = held;
  }
  const NormalEquations agreeing = plane_equations(planes, selected, coarse.T_map_moving, metric);
  coarse.equations.inliers = agreeing.inliers;
  coarse.equations.agreement = agreeing.agreement;
  return coarse;
}

void Odometry::State::register_points(bool coarse, PlaneMetric metric, OdometryResult& result) {
  const bool by_accelerometer = motion_prior.is_stationary || motion_prior.inputs.accelerometer;
  RegistrationResult by_coarse;
  int widenings = 0;
  is_manoeuvring = false;
  for (int pass = 0; pass < config.max_passes; ++pass) {
    if (pass > 0 && !budget.allows(WorkKind::kIcp, selected_sweep.size())) {
      registration.stop_reason = StopReason::kBudget;
      return;
    }
    const std::optional<PosePrior> prior = pose_prior();
    metric.gaussian_weight = gaussian_weight(prior);
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
    if (has_failed && has_found_pose(by_coarse)) registration = kept_coarse(by_coarse, metric, prior);
    ++result.passes;
    if (has_no_time()) return;
    if (!registration.T_map_moving.is_finite()) return;
    if (relocalized) {
      if (registration.stop_reason != StopReason::kMaxIterations) return;
      continue;
    }
    const bool is_settled = refine_motion();
    if (widenings < kMaxWidenings &&
        motion_filter.adapt_to_manoeuvre(registration.T_map_moving, motion_prior.inputs)) {
      const MotionFilter adapted = motion_filter;
      motion_filter = last_filter;
      motion_filter.adapt_as(adapted);
      motion_filter.propagate(motion_prior.inputs, motion_prior.span.middle());
      metric = metric_of_prediction();
      ++widenings;
      is_manoeuvring = !motion_prior.inputs.gyro && !motion_compensated && !is_gap(motion_prior.span_s());
      --pass;
      static_cast<void>(refine_motion());
      continue;
    }
    if (is_settled || motion_compensated) return;
  }
}

/// Arena of this registration; results do not depend on it.
tbb::task_arena& Odometry::State::registration_arena() {
  const bool is_little = scans > 1 && !coarse_is_due() && failures == 0 &&
                         last_fine_iterations * selected_sweep.size() < kMinSharedWork;
  return is_little ? single_thread_arena : arena;
}

void Odometry::State::register_predicted(OdometryResult& result) {
  registration = {};
  registration.T_map_moving = T_predicted;
  coarse_was_due = coarse_is_due();
  if (scans == 1) {
    if (!motion_is_known) find_initial_velocity(result);
    select_points(T_predicted);
  }
  register_points(coarse_was_due, metric_of_prediction(), result);
  if (scans == 1 && motion_is_known) {
    motion_is_known = fits_prediction();
    if (!motion_is_known) return register_predicted(result);
  }
  count_inliers(result);
}

void Odometry::State::register_sweep(OdometryResult& result) {
  register_predicted(result);
  if (sweep.empty() || has_no_time()) return;
  reconsider_stationary(result);
  if (scans < kInitialScans || motion_prior.is_stationary) return;
  reconsider_imu(result);
  if (is_doubtful()) compare_hypotheses(result);
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

/// Motion between the midpoints of two sweeps.
RegisteredMotion Odometry::State::registered_motion() const {
  return {last_middle, motion_prior.span.middle(), T_map_last_middle, registration.T_map_moving};
}

Odometry::State::Hypothesis Odometry::State::hypothesis() const {
  return {motion_prior, motion_filter,     motion,
          registration, registered_points, has_pose() ? agreement() : 0.0};
}

void Odometry::State::return_to(const Hypothesis& earlier, OdometryResult& result) {
  motion_prior = earlier.prior;
  motion_filter = earlier.filter;
  motion = earlier.motion;
  registration = earlier.registration;
  registered_points = earlier.points;
  T_predicted = motion_filter.state().T_map_base;
  sigma_m = prediction_deviation();
  count_inliers(result);
}

/// Other vehicles move the scan of a stationary one, and the IMU does not see a smooth walking pace: the
/// vehicle is stationary unless the map agrees much better with a motion.
void Odometry::State::reconsider_stationary(OdometryResult& result) {
  if (!motion_prior.is_stationary || scans == 1) return;
  if (fits_prediction()) return;
  const Hypothesis stationary = hypothesis();
  motion_prior.is_stationary = false;
  motion_filter = last_filter;
  motion_filter.set_twist(Vector6::Zero(), Vector6::Constant(kWalkingSpeed * kWalkingSpeed));
  predict_motion();
  select_points(T_predicted);
  register_predicted(result);
  if (is_plausible() && kAgreementCollapse * agreement() > stationary.agreement) {
    end_stationary();
  } else {
    return_to(stationary, result);
  }
}

/// A wrong IMU distorts the scan by deskewing and holds the pose: where the two do not agree, the scan is
/// registered without it, and what agrees better with the map is kept.
void Odometry::State::reconsider_imu(OdometryResult& result) {
  if (!motion_prior.inputs.gyro) return;
  const bool is_contradicted =
      is_plausible() && monitor.contradicts(imu, motion_filter.state().gyro_bias, registered_motion());
  if (!is_contradicted && !is_doubtful()) return;
  const Hypothesis with_imu = hypothesis();
  motion_prior.inputs.gyro = motion_prior.inputs.accelerometer = false;
  motion_filter = last_filter;
  predict_motion();
  select_points(T_predicted);
  register_predicted(result);
  if (is_plausible() && (is_contradicted || agreement() > with_imu.agreement)) {
    result.imu_used = false;
    if (is_contradicted || monitor.contradicts(imu, motion_filter.state().gyro_bias, registered_motion()))
      monitor.demote();
    return;
  }
  return_to(with_imu, result);
}

}  // namespace nilio::core
