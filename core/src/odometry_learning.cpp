#include "odometry_state.hpp"
#include "registration_solver.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

// Forgetting factor of the prediction error that the gate follows.
constexpr double kErrorMemory = 0.9;
constexpr int kGuessIsForgotten = 100;
constexpr double kPeriodMemory = 0.9;
// An agreement with the map below this part of its running mean is not tracking.
constexpr double kAgreementCollapse = 0.75;
constexpr double kAgreementMemory = 0.95;
// Poses in a row that are predicted, and that agree with the map worse than usual.
constexpr int kLostAfterFailures = 5;
constexpr int kLostAfterDoubts = 8;
// No road vehicle is faster, or turns faster.
constexpr double kMaxSpeed = 90.0;
constexpr double kMaxTurnRate = 6.0;
// Nor is it pushed or turned harder without being wrecked.
constexpr double kMaxAcceleration = 50.0;
constexpr double kMaxTurnAcceleration = 10.0;
constexpr double kGyroBiasGain = 0.02;
constexpr double kMaxGyroBias = 0.1;
constexpr double kCalmTurnRate = 0.02;
// Half a step of the search for a start.
constexpr double kStartSpeedError = 5.0;

/// How far it moves a point at the lever's end, at most.
double metres_of(const SE3& error) {
  const double angle = so3_log(error.rotation).norm();
  return error.translation.norm() + 2.0 * kErrorLeverMetres * std::sin(0.5 * angle);
}

}  // namespace

bool Odometry::State::has_pose() const {
  return registration.T_map_moving.is_finite() && registration.stop_reason != StopReason::kTooFewPoints &&
         registration.stop_reason != StopReason::kNonFinite && !has_no_time();
}

bool Odometry::State::is_plausible() const {
  if (!has_pose() || motion.body_velocity().norm() > kMaxSpeed ||
      motion.mean_angular_velocity().norm() > kMaxTurnRate)
    return false;
  // A place that was searched for is a local optimum, or nothing: none is somewhere on the way to one.
  return !relocated || has_converged();
}

double Odometry::State::agreement() const {
  return registered_points == 0 ? 0.0
                                : registration.equations.agreement / static_cast<double>(registered_points);
}

bool Odometry::State::is_in_family() const {
  return scans < kInitialScans || agreement() > kAgreementCollapse * mean_agreement;
}

bool Odometry::State::is_doubtful() const { return !is_plausible() || !is_in_family(); }

SE3 Odometry::State::prediction_error() const { return T_predicted.inverse() * registration.T_map_moving; }

/// Whether a vehicle can have been accelerated so far off a constant motion in that time.
bool Odometry::State::is_drivable(const SE3& off, double seconds) {
  return off.translation.norm() <= kMaxAcceleration * seconds * seconds &&
         so3_log(off.rotation).norm() <= kMaxTurnAcceleration * seconds * seconds;
}

/// Whether a vehicle can have driven from the last published pose to this one.
bool Odometry::State::is_drivable_step(const SE3& T_map_end, double seconds) const {
  const SE3 step = T_published.inverse() * T_map_end;
  // A corrected speed is no jump.
  const double speed = std::max(published_speed, motion.body_velocity().norm());
  const double reach = std::min(kMaxSpeed, speed + kMaxAcceleration * seconds) * seconds + kScanErrorMetres;
  return step.translation.norm() <= reach &&
         so3_log(step.rotation).norm() <= kMaxTurnRate * seconds + kScanErrorMetres;
}

/// Farther from its prediction than scans lately were from theirs, and than any acceleration brings it since
/// it was seen last.
bool Odometry::State::is_out_of_reach() const {
  const SE3 error = prediction_error();
  if (scans < kInitialScans || metres_of(error) < kGateSigmas * sigma_m) return false;
  return !is_drivable(error, ahead.span_s() * (failures + 1));
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
  const SE3 error = prediction_error();
  const Vector3 turn = so3_log(error.rotation);
  Vector6 squares;
  squares << error.translation.cwiseAbs2(), turn.cwiseAbs2();
  // A manoeuvre is believed at once, calm only after a while, and only where the scan would have shown it: an
  // axis that follows the prediction teaches nothing of its errors.
  const Vector6 expected = prediction_square.cwiseProduct(registration.observed_share);
  prediction_square = squares.cwiseMax(prediction_square + (1.0 - kErrorMemory) * (squares - expected));
  prediction_error_m = metres_of(error);
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
  if (is_felt()) {
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
  } else {
    felt_motion.forget();
  }
}

void Odometry::State::correct_felt_motion() {
  const Vector3 moved = prediction_error().translation;
  const Vector3 change = felt_motion.correct(T_predicted.rotation.toRotationMatrix(), moved,
                                             registration.observed_share.head<3>());
  felt_velocity.know_support(felt_velocity.judge().support() + change, felt_motion.support_variance());
  if (felt_motion.is_contradicted()) forget_felt_motion();
}

void Odometry::State::forget_felt_motion() {
  felt_velocity.reset();
  felt_motion.forget();
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
    felt_motion.forget();
    // Something brought it there that the accelerometer did not feel.
    if (is_out_of_reach()) felt_velocity.reset();
    forget_prediction_error();
  } else {
    learn_motion();
  }
  if (!motion_compensated) result.deskew_rate = deskew_rate;
  doubtful = !is_in_family() || relocated;
  const double memory = mean_agreement == 0.0 ? 0.0 : kAgreementMemory;
  if (!doubtful) mean_agreement = memory * mean_agreement + (1.0 - memory) * agreement();
  doubts = doubtful ? doubts + 1 : 0;
  if (!doubtful) searches = 0;
  failures = 0;
  count_scan_with_ndt();
  const double span_s = ahead.span_s();
  period_s = scans == 1 ? span_s : kPeriodMemory * period_s + (1.0 - kPeriodMemory) * span_s;
  T_map_base = registration.T_map_moving;
  T_accepted = T_map_base;
  result.stop_reason = registration.stop_reason;
  result.degenerate_axes = registration.degenerate_axes;
  const bool is_degraded = registration.degenerate_axes != 0 || doubtful;
  result.state = scans < kInitialScans        ? TrackingState::kInitialising
                 : doubts >= kLostAfterDoubts ? TrackingState::kLost
                 : is_degraded                ? TrackingState::kDegraded
                                              : TrackingState::kTracking;
}

TrackingState Odometry::State::state_without_registration(int scans_to_come) const {
  if (scans < kInitialScans) return TrackingState::kInitialising;
  return failures + scans_to_come >= kLostAfterFailures ? TrackingState::kLost : TrackingState::kDegraded;
}

void Odometry::State::fall_back(OdometryResult& result) {
  ++failures;
  ++doubts;
  skip_motion();
  motion.predict(expected_twist(ahead).head<3>());
  twist.hold(measured_step());
  T_map_base = T_predicted;
  sigma_m = std::min(kMaxSigmaMetres, 2.0 * sigma_m);
  result.predicted = true;
  result.stop_reason = registration.stop_reason == StopReason::kConverged ? StopReason::kDegenerate
                       : sweep.empty() && budget.was_short()              ? StopReason::kBudget
                                                                          : registration.stop_reason;
  result.state = state_without_registration();
}

void Odometry::State::judge(OdometryResult& result) {
  const bool is_tracked = !relocated && has_converged();
  if (is_plausible() && (is_tracked || is_in_family() || !is_out_of_reach())) {
    accept(result);
  } else {
    fall_back(result);
  }
}

}  // namespace nilio::core
