#include "odometry_state.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

// The gate follows the prediction error: forgetting factor, limits, and the lever that turns rotation into
// distance.
constexpr double kErrorMemory = 0.9;
constexpr int kGuessIsForgotten = 100;
constexpr double kMinSigmaMetres = 0.1;
constexpr double kErrorLeverMetres = 30.0;
constexpr double kGateSigmas = 3.0;
constexpr double kKernelSigmas = 0.5;
// Deskewing again pays only when the ends of the sweep move by more than registration resolves.
constexpr double kMotionEpsilonMetres = 2.5e-3;
constexpr double kMotionEpsilonRadians = 2.5e-4;
// Points times iterations of ICP, about 0.2 ms, for which a second thread is worth waking.
constexpr std::size_t kLeastSharedWork = 4000;
constexpr double kCoarseTriggerErrorMetres = 0.5;
constexpr double kCoarseTriggerGap = 1.5;
constexpr double kPeriodMemory = 0.9;
// An inlier share below this part of its running mean is not tracking.
constexpr double kInlierCollapse = 0.6;
// Where the prediction is worth little a wrong pose is as easily found as the right one: more is asked for.
// Few points that happen to meet a plane agree with it anywhere, so their number counts, too.
constexpr double kInlierReturn = 0.75;
constexpr double kInlierCountReturn = 0.25;
constexpr double kInlierMemory = 0.95;
constexpr int kLostAfterFailures = 5;
// No road vehicle is faster, or turns faster.
constexpr double kMaxSpeed = 90.0;
constexpr double kMaxTurnRate = 6.0;
constexpr double kGyroBiasGain = 0.02;
constexpr double kMaxGyroBias = 0.1;
constexpr double kCalmTurnRate = 0.02;
// What an IMU tells of a vehicle that stands, and what velocities and supports are not known better than by
// scans alone.
constexpr double kStandingSpeedVariance = 0.02 * 0.02;
constexpr double kStandingSupportVariance = 0.02 * 0.02;
constexpr double kLeastVelocityVariance = 0.1 * 0.1;
constexpr double kLeastSupportVariance = 0.01 * 0.01;
// Half a step of the search for a start.
constexpr double kStartSpeedError = 5.0;

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

void Odometry::State::set_rotation(const SweepMotion::Span& target_span, bool with_imu,
                                   const Vector6& expected, SweepMotion& target) const {
  if (with_imu) {
    target.set_rotation_from_imu(target_span, imu, gyro_bias);
  } else {
    target.set_constant_rotation(target_span, expected.tail<3>());
  }
}

TurnRate Odometry::State::turn_rate(bool by_gyro) const {
  TurnRate rate{imu, gyro_bias, {}};
  if (!by_gyro) rate.held = twist.twist().tail<3>();
  return rate;
}

/// What the accelerometer says of the time from the middle of the last sweep to that of the next one.
std::optional<Vector3> Odometry::State::felt_acceleration(const Outlook& next) const {
  const SweepMotion::Span& span = next.span;
  const Time from = span.previous - Duration::from_seconds(0.5 * last_sweep_s);
  if (!monitor.force_usable(from)) return std::nullopt;
  return felt_velocity.acceleration(turn_rate(next.imu_used), from, span.end - (span.end - span.start) / 2,
                                    T_map_base.rotation * last_half_sweep.rotation.conjugate(),
                                    twist.twist().head<3>());
}

/// What stands is held still and shows what its accelerometer feels while it does.
bool Odometry::State::stands_since_start() {
  const bool is_felt = ahead.imu_covers && monitor.force_usable(ahead.span.previous);
  if (is_felt) {
    const Time end = ahead.span.end;
    return standing_start.observe(imu_statistics(imu, end - StandingStart::kWindow, end),
                                  T_map_base.translation);
  }
  if (scans >= kInitialScans) standing_start.end();
  return false;
}

/// How exact the prediction is where the accelerometer carries it on.
void Odometry::State::advance_felt_motion() {
  if (ahead.stands) {
    felt_motion.begin({kStandingSpeedVariance, kStandingSupportVariance});
    return;
  }
  const AccelerometerJudge& judge = felt_velocity.judge();
  if (!ahead.acceleration) {
    felt_motion.begin({std::max(kLeastVelocityVariance, judge.velocity_variance()),
                       std::max(kLeastSupportVariance, judge.support_variance())});
  }
  const double seconds = motion.between_s(last_sweep_s);
  felt_motion.advance(seconds, seconds * motion.mean_angular_velocity().z());
}

/// Between the middles of the last sweep and of this one.
TwistStep Odometry::State::measured_step() const {
  const double seconds = motion.between_s(last_sweep_s);
  const Matrix3 R = T_predicted.rotation.toRotationMatrix();
  return {seconds, ahead.acceleration, seconds * felt_motion.velocity_gain(R)};
}

/// Over the middle of the span, which the prediction is for.
Vector6 Odometry::State::expected_twist(const Outlook& next) const {
  return twist.predict({next.span_s(), next.acceleration});
}

SE3 Odometry::State::expected_pose(const Outlook& next, SweepMotion& target) const {
  const Vector6 expected = expected_twist(next);
  set_rotation(next.span, next.imu_used, expected, target);
  return T_map_base * target.predict(expected.head<3>());
}

void Odometry::State::predict(const Scan& scan, OdometryResult& result) {
  ahead = outlook(scan);
  relocated = failures > 0;
  ahead.stands = stands_since_start();
  if (ahead.stands && scans > 1) ahead.acceleration = Vector3::Zero();
  T_predicted = expected_pose(ahead, motion);
  advance_felt_motion();
  result.imu_used = ahead.imu_used;
}

void Odometry::State::select_points() {
  motion.deskew(sweep, deskewed);
  const std::size_t target = budget.choose_registration_points(config.registration_points, coarse_is_due());
  const SelectionConfig selection_config{target, kCoarseVoxelMetres, plane_metric().max_planarity};
  selector.select(planes, filter, deskewed, T_predicted, selection_config, selection);
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

PlaneMetric Odometry::State::plane_metric() const {
  PlaneMetric metric;
  metric.gate_m = kGateSigmas * sigma_m;
  metric.kernel_scale_m = kKernelSigmas * sigma_m;
  return metric;
}

RegistrationResult Odometry::State::register_fine(const std::vector<Eigen::Vector3f>& points,
                                                  const SE3& T_guess, const std::optional<PosePrior>& prior,
                                                  OdometryResult& result) {
  SolverOptions options;
  options.max_iterations = config.max_fine_iterations;
  options.prior = prior;
  options.budget = &budget;
  const RegistrationMaps maps{&planes, &coarse_map, point_map ? &*point_map : nullptr};
  const RegistrationResult fine = method.refine(maps, points, T_guess, plane_metric(), options);
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
  const bool stands = ahead.stands && scans > 1;
  if (relocated || (!stands && (scans < kInitialScans || after_gap()))) return std::nullopt;
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

/// What NDT found, where ICP found no time. All of its points count that met a voxel.
RegistrationResult Odometry::State::kept_coarse(RegistrationResult coarse) const {
  coarse.stop_reason = StopReason::kBudget;
  coarse.equations.inliers = static_cast<std::uint32_t>(
      std::min(selected.size(), coarse.equations.correspondences * selected.size() / coarse_points.size()));
  return coarse;
}

void Odometry::State::register_points(bool coarse, OdometryResult& result) {
  const std::optional<PosePrior> prior = pose_prior();
  RegistrationResult by_coarse;
  for (int pass = 0; pass < config.max_passes; ++pass) {
    if (pass > 0 && !budget.allows(Work::kIcp, selected_sweep.size())) {
      registration.stop_reason = StopReason::kBudget;
      return;
    }
    motion.deskew(selected_sweep, selected);
    if (coarse && pass == 0) by_coarse = register_coarse(result);
    if (pass == 0) stamp(result, OdometryStage::kCoarse);
    registration = register_fine(selected, registration.T_map_moving, prior, result);
    if (has_no_time() && has_found_pose(by_coarse)) registration = kept_coarse(by_coarse);
    ++result.passes;
    if (has_no_time()) return;
    if (!registration.T_map_moving.is_finite()) return;
    if (relocated) return;
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
    select_points();
  }
  register_points(coarse_was_due, result);
  count_inliers(result);
  if (scans < kInitialScans || is_plausible(result) || sweep.empty() || has_no_time()) return;
  search_lost_vehicle(result);
  register_points(false, result);
  count_inliers(result);
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
  result.points_used = static_cast<std::uint32_t>(selected.size());
  result.correspondences = registration.equations.correspondences;
  result.inlier_ratio = selected.empty() ? 0.0
                                         : static_cast<double>(registration.equations.inliers) /
                                               static_cast<double>(selected.size());
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
  if (!ahead.imu_used || relocated || !is_plausible(result) ||
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
  select_points();
  register_sweep(result);
}

bool Odometry::State::is_plausible(const OdometryResult& result) const {
  const RegistrationResult& r = registration;
  if (!r.T_map_moving.is_finite() || r.stop_reason == StopReason::kTooFewPoints ||
      r.stop_reason == StopReason::kNonFinite || has_no_time()) {
    return false;
  }
  if (motion.body_velocity().norm() > kMaxSpeed || motion.mean_angular_velocity().norm() > kMaxTurnRate)
    return false;
  if (scans < kInitialScans) return true;
  if (failures == 0 && !after_gap()) return result.inlier_ratio > kInlierCollapse * mean_inlier_ratio;
  return result.inlier_ratio > kInlierReturn * mean_inlier_ratio &&
         registration.equations.inliers > kInlierCountReturn * mean_inliers;
}

void Odometry::State::learn_gyro_bias() {
  const RegisteredMotion step = registered_motion();
  if (!ahead.imu_covers || step.seconds() <= 0.0) return;
  const Vector3 rate = step.mean_rate();
  // While turning, a gyro that is not trusted may differ by more than its bias.
  if (!ahead.imu_used && rate.norm() > kCalmTurnRate) return;
  const Vector3 error = mean_angular_velocity(imu, step.from, step.to) - gyro_bias - rate;
  const double gain = std::max(kGyroBiasGain, 1.0 / static_cast<double>(bias_updates + 2));
  ++bias_updates;
  gyro_bias = (gyro_bias + gain * error).cwiseMax(-kMaxGyroBias).cwiseMin(kMaxGyroBias);
}

void Odometry::State::learn_prediction_error() {
  const SE3 error = T_predicted.inverse() * registration.T_map_moving;
  const Vector3 turn = so3_log(error.rotation);
  Vector6 squares;
  squares << error.translation.cwiseAbs2(), turn.cwiseAbs2();
  // A manoeuvre is believed at once, calm only after a while, and only where the scan would have shown it: an
  // axis that follows the prediction teaches nothing of its errors.
  const Vector6 expected = prediction_square.cwiseProduct(registration.observed_share);
  prediction_square = squares.cwiseMax(prediction_square + (1.0 - kErrorMemory) * (squares - expected));
  const double angle = turn.norm();
  prediction_error_m = error.translation.norm() + 2.0 * kErrorLeverMetres * std::sin(0.5 * angle);
  // What it begins with is a guess, worth one scan.
  sigma_scans = std::min(sigma_scans + 1, kGuessIsForgotten);
  const double memory = std::min(kErrorMemory, 1.0 - 1.0 / (sigma_scans + 1));
  const double square = memory * sigma_m * sigma_m + (1.0 - memory) * prediction_error_m * prediction_error_m;
  sigma_m = std::clamp(std::sqrt(square), kMinSigmaMetres, kMaxSigmaMetres);
}

/// How much of the motion along each axis the scan showed, rather than followed.
Vector3 Odometry::State::seen_share() const {
  Vector3 share = registration.observed_share.head<3>();
  for (int axis = 0; axis < 3; ++axis) {
    if ((registration.degenerate_axes >> axis & 1) != 0) share[axis] = 0.0;
  }
  return share;
}

void Odometry::State::learn_felt_velocity() {
  if (ahead.imu_covers && monitor.force_usable(ahead.span.previous)) {
    felt_velocity.learn(turn_rate(ahead.imu_used), registered_motion(), measured_twist.head<3>(),
                        seen_share(), ahead.acceleration.has_value());
  } else {
    felt_velocity.interrupt();
  }
}

/// What lies between the last pose and this one is no motion to judge the IMU by.
void Odometry::State::skip_motion() {
  monitor.skip();
  felt_velocity.interrupt();
}

void Odometry::State::learn_motion() {
  learn_felt_velocity();
  const bool is_shifted = monitor.observe(imu, gyro_bias, registered_motion());
  learn_gyro_bias();
  if (is_shifted) {
    imu.clear();
    felt_velocity.interrupt();
  }
  learn_prediction_error();
  learn_velocity();
}

void Odometry::State::learn_velocity() {
  if (scans < kInitialScans) {
    twist.reset(measured_twist);
  } else {
    twist.learn(measured_twist, registration.observed_share, measured_step());
  }
  if (ahead.stands && scans == 1 && measured_twist.head<3>().norm() > kStartSpeedError) standing_start.end();
  if (ahead.stands && !standing_start.is_over()) {
    twist.stand();
    felt_velocity.know_support(registration.T_map_moving.rotation * standing_start.mean_force(),
                               kStandingSupportVariance);
  } else if (ahead.acceleration) {
    correct_felt_motion();
  }
}

void Odometry::State::correct_felt_motion() {
  const Vector3 moved = (T_predicted.inverse() * registration.T_map_moving).translation;
  const Vector3 change = felt_motion.correct(T_predicted.rotation.toRotationMatrix(), moved,
                                             registration.observed_share.head<3>());
  felt_velocity.know_support(felt_velocity.judge().support() + change, felt_motion.support_variance());
}

void Odometry::State::forget_prediction_error() {
  sigma_m = kMaxSigmaMetres;
  sigma_scans = 0;
}

void Odometry::State::count_scan_with_ndt() {
  if (scans_with_ndt == 0) return;
  scans_with_ndt = registration.degenerate_axes == 0 ? scans_with_ndt - 1 : kScansToBeSure;
}

void Odometry::State::accept(OdometryResult& result) {
  if (relocated) {
    skip_motion();
    felt_motion.forget_place();
    forget_prediction_error();
  } else {
    learn_motion();
  }
  if (!motion_compensated) result.deskew_rate = deskew_rate;
  const double memory = mean_inlier_ratio == 0.0 ? 0.0 : kInlierMemory;
  mean_inlier_ratio = memory * mean_inlier_ratio + (1.0 - memory) * result.inlier_ratio;
  mean_inliers = memory * mean_inliers + (1.0 - memory) * registration.equations.inliers;
  failures = 0;
  count_scan_with_ndt();
  const double span_s = ahead.span_s();
  period_s = scans == 1 ? span_s : kPeriodMemory * period_s + (1.0 - kPeriodMemory) * span_s;
  T_map_base = registration.T_map_moving;
  T_accepted = T_map_base;
  result.stop_reason = registration.stop_reason;
  result.degenerate_axes = registration.degenerate_axes;
  result.state = scans < kInitialScans                            ? TrackingState::kInitialising
                 : registration.degenerate_axes != 0 || relocated ? TrackingState::kDegraded
                                                                  : TrackingState::kTracking;
}

TrackingState Odometry::State::state_without_registration(int failures_in_a_row) const {
  if (scans < kInitialScans) return TrackingState::kInitialising;
  return failures_in_a_row >= kLostAfterFailures ? TrackingState::kLost : TrackingState::kDegraded;
}

void Odometry::State::fall_back(OdometryResult& result) {
  ++failures;
  skip_motion();
  motion.predict(expected_twist(ahead).head<3>());
  twist.hold(measured_step());
  T_map_base = T_predicted;
  sigma_m = std::min(kMaxSigmaMetres, 2.0 * sigma_m);
  result.predicted = true;
  result.stop_reason = registration.stop_reason == StopReason::kConverged ? StopReason::kDegenerate
                       : sweep.empty() && budget.was_short()              ? StopReason::kBudget
                                                                          : registration.stop_reason;
  result.state = state_without_registration(failures);
}

void Odometry::State::judge(OdometryResult& result) {
  if (is_plausible(result)) {
    accept(result);
  } else {
    fall_back(result);
  }
}

}  // namespace nilio::core
