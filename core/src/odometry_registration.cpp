#include "odometry_state.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

// The kernel, as the gate, follows the prediction error.
constexpr double kKernelSigmas = 0.5;
// Deskewing again pays only when the ends of the sweep move by more than registration resolves.
constexpr double kMotionEpsilonMetres = 2.5e-3;
constexpr double kMotionEpsilonRadians = 2.5e-4;
// Points times iterations of ICP, about 0.2 ms, for which a second thread is worth waking.
constexpr std::size_t kLeastSharedWork = 4000;
constexpr double kCoarseTriggerErrorMetres = 0.5;
constexpr double kCoarseTriggerGap = 1.5;

/// However well the last scans were predicted, the next one may begin a gentle manoeuvre: 1 m/s^2, or what
/// turns a point 30 m away as far, over a tenth of a second.
Vector6 least_prediction_square() {
  constexpr double kLeastMetres = 0.01;
  Vector6 square;
  square << Vector3::Constant(kLeastMetres * kLeastMetres),
      Vector3::Constant(kLeastMetres * kLeastMetres / (kErrorLeverMetres * kErrorLeverMetres));
  return square;
}

/// Whether it is worth going on from, also where the time was over before it converged.
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
  thin_evenly(deskewed, kCoarsePoints, coarse_points);
}

bool Odometry::State::coarse_is_due() const {
  if (!method.coarse) return false;
  if (config.coarse == CoarsePolicy::kAlways || scans_with_ndt > 0 || failures > 0) return true;
  return prediction_error_m > kCoarseTriggerErrorMetres || after_gap();
}

bool Odometry::State::after_gap() const { return ahead.span_s() > kCoarseTriggerGap * period_s; }

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

/// Nothing where the prediction is worth nothing.
std::optional<PosePrior> Odometry::State::pose_prior() const {
  if (relocated || (!is_held_still() && (scans < kInitialScans || after_gap()))) return std::nullopt;
  PosePrior prior{T_predicted, prediction_square.cwiseMax(least_prediction_square())};
  if (ahead.acceleration) {
    prior.variance.head<3>() = felt_motion.place_variance(T_predicted.rotation.toRotationMatrix());
    prior.translation_is_felt = true;
  }
  return prior;
}

/// Returns by how much the motion that is known now moves the end of the sweep.
SE3 Odometry::State::refine_motion(SE3& T_map_end) {
  const SE3 T_registered = T_map_end;
  const SE3 T_previous_end = T_map_base.inverse() * T_registered;
  measured_twist = motion.measure(T_previous_end, last_half_sweep, last_sweep_s);
  // Nothing is predicted yet that could be worth keeping.
  const bool initial = scans < kInitialScans;
  const Vector6 wanted =
      initial ? measured_twist : twist.correct(measured_twist, registration.observed_share, measured_step());
  T_map_end = T_map_base * motion.refine(T_previous_end, wanted);
  deskew_rate = motion.mean_angular_velocity();
  return T_registered.inverse() * T_map_end;
}

/// What NDT found, where ICP found too few points or no time. NDT has no inliers of its own.
RegistrationResult Odometry::State::kept_coarse(RegistrationResult coarse, const PlaneMetric& metric) {
  if (has_no_time()) coarse.stop_reason = StopReason::kBudget;
  const NormalEquations agreeing = plane_equations(planes, selected, coarse.T_map_moving, metric);
  coarse.equations.inliers = agreeing.inliers;
  coarse.equations.agreement = agreeing.agreement;
  return coarse;
}

void Odometry::State::register_points(bool coarse, const PlaneMetric& metric, OdometryResult& result) {
  const std::optional<PosePrior> prior = pose_prior();
  RegistrationResult by_coarse;
  for (int pass = 0; pass < config.max_passes; ++pass) {
    if (pass > 0 && !budget.allows(Work::kIcp, selected_sweep.size())) {
      registration.stop_reason = StopReason::kBudget;
      return;
    }
    motion.deskew(selected_sweep, selected);
    registered_points = selected.size();
    if (coarse && pass == 0) by_coarse = register_coarse(result);
    if (pass == 0) stamp(result, OdometryStage::kCoarse);
    registration = register_fine(selected, registration.T_map_moving, metric, prior, result);
    // A minimum among few points is worth less than NDT's.
    const bool has_failed = !has_pose() || 2 * registration.equations.correspondences <
                                               by_coarse.equations.correspondences;
    if (has_failed && has_found_pose(by_coarse)) registration = kept_coarse(by_coarse, metric);
    ++result.passes;
    if (has_no_time()) return;
    if (!registration.T_map_moving.is_finite()) return;
    if (relocated) {
      if (registration.stop_reason != StopReason::kMaxIterations) return;
      continue;
    }
    const SE3 change = refine_motion(registration.T_map_moving);
    const bool settled = change.translation.norm() < kMotionEpsilonMetres &&
                         so3_log(change.rotation).norm() < kMotionEpsilonRadians;
    if (settled || motion_compensated) return;
  }
}

/// The same bits from either.
tbb::task_arena& Odometry::State::registration_arena() {
  const bool is_little = scans > 1 && !coarse_is_due() && failures == 0 &&
                         last_fine_iterations * selected_sweep.size() < kLeastSharedWork;
  return is_little ? lone_arena : arena;
}

void Odometry::State::register_sweep(OdometryResult& result) {
  registration = {};
  registration.T_map_moving = T_predicted;
  coarse_was_due = coarse_is_due();
  if (scans == 1) {
    register_from_standstill(result);
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

/// The time was over before the first iteration, which says nothing of where the vehicle is.
bool Odometry::State::has_no_time() const {
  return registration.stop_reason == StopReason::kBudget && registration.iterations == 0;
}

BudgetRung Odometry::State::rung_of(const OdometryResult& result) const {
  if (!budget.was_short()) return BudgetRung::kFull;
  const bool has_coarse = result.coarse_iterations > 0;
  if (result.fine_iterations == 0) return has_coarse ? BudgetRung::kNdtOnly : BudgetRung::kPredictionOnly;
  return method.coarse && coarse_was_due && !has_coarse ? BudgetRung::kIcpOnly : BudgetRung::kFewerPoints;
}

void Odometry::State::count_inliers(OdometryResult& result) const {
  result.points_used = static_cast<std::uint32_t>(registered_points);
  result.correspondences = registration.equations.correspondences;
  result.inlier_ratio = registered_points == 0 ? 0.0
                                               : static_cast<double>(registration.equations.inliers) /
                                                     static_cast<double>(registered_points);
}

/// From the middle of one sweep to that of the next, which deskewing with a wrong motion hardly moves.
RegisteredMotion Odometry::State::registered_motion() const {
  const SweepMotion::Span& span = ahead.span;
  return {span.previous - Duration::from_seconds(0.5 * last_sweep_s),
          span.end - Duration::from_seconds(0.5 * motion.sweep_s()), T_map_base * last_half_sweep.inverse(),
          registration.T_map_moving * motion.half_sweep().inverse()};
}

/// A gyro that the registration contradicts has already bent the scan by deskewing it: once more, without it.
void Odometry::State::reconsider_imu(OdometryResult& result) {
  if (!ahead.imu_used || relocated || !is_plausible() ||
      !monitor.contradicts(imu, gyro_bias, registered_motion()))
    return;
  monitor.demote();
  ahead.imu_used = false;
  ahead.acceleration = felt_acceleration(ahead);
  result.imu_used = false;
  Vector6 expected = expected_twist(ahead);
  expected.tail<3>() = monitor.registered_rate();
  set_rotation(ahead.span, false, expected, motion);
  T_predicted = T_map_base * motion.predict(expected.head<3>());
  select_points(T_predicted);
  register_sweep(result);
}

}  // namespace nilio::core
