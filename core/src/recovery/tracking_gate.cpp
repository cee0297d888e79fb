#include "nilio/core/portable_math.hpp"

#include "core/src/odometry_impl.hpp"
#include "core/src/registration/gauss_newton.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

// Forgetting factor of the prediction error that the gate follows.
constexpr double kErrorMemory = 0.9;
constexpr int kGuessIsForgotten = 100;
constexpr double kPeriodMemory = 0.9;
// Share of the running mean below which the agreement with the map is out of family.
constexpr double kAgreementCollapse = 0.75;
constexpr double kAgreementMemory = 0.95;
// Number of predicted poses, and of poses out of family, in a row until the state is lost.
constexpr int kLostAfterFailures = 5;
constexpr int kLostAfterDoubts = 8;
// Maximum speed and turn rate of a road vehicle.
constexpr double kMaxSpeed = 90.0;
constexpr double kMaxTurnRate = 6.0;
// Maximum acceleration, short of an accident.
constexpr double kMaxAcceleration = 50.0;
constexpr double kMaxTurnAcceleration = 10.0;
constexpr double kGyroBiasGain = 0.02;
constexpr double kMaxGyroBias = 0.1;
constexpr double kCalmTurnRate = 0.02;
// Half a step of the initial velocity search.
constexpr double kStartSpeedError = 5.0;

/// Maximum displacement of a point at the lever.
double metres_of(const SE3& error) {
  const double angle = so3_log(error.rotation).norm();
  return error.translation.norm() + 2.0 * kErrorLeverMetres * portable::sin(0.5 * angle);
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
  // A relocalised pose must be a local optimum.
  return !relocalized || has_converged();
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

/// Whether the deviation from constant motion is within the acceleration limits.
bool Odometry::State::is_drivable(const SE3& off, double seconds) {
  return off.translation.norm() <= kMaxAcceleration * seconds * seconds &&
         so3_log(off.rotation).norm() <= kMaxTurnAcceleration * seconds * seconds;
}

/// Whether the step from the last published pose is within the motion limits.
bool Odometry::State::is_drivable_step(const SE3& T_map_end, double seconds) const {
  const SE3 step = T_published.inverse() * T_map_end;
  // A corrected speed estimate is not a jump.
  const double speed = std::max(published_speed, motion.body_velocity().norm());
  const double reach = std::min(kMaxSpeed, speed + kMaxAcceleration * seconds) * seconds + kScanErrorMetres;
  return step.translation.norm() <= reach &&
         so3_log(step.rotation).norm() <= kMaxTurnRate * seconds + kScanErrorMetres;
}

/// Outlier: beyond both the recent prediction errors and the acceleration limits.
bool Odometry::State::exceeds_motion_limits() const {
  const SE3 error = prediction_error();
  if (scans < kInitialScans || metres_of(error) < kGateSigmas * sigma_m) return false;
  return !is_drivable(error, motion_prior.span_s() * (failures + 1));
}

void Odometry::State::update_gyro_bias() {
  const RegisteredMotion step = registered_motion();
  if (!motion_prior.imu_covers || step.seconds() <= 0.0) return;
  const Vector3 rate = step.mean_rate();
  // In turns an unused gyro may differ by more than its bias.
  if (!motion_prior.imu_used && rate.norm() > kCalmTurnRate) return;
  const Vector3 error = mean_angular_velocity(imu, step.from, step.to) - gyro_bias - rate;
  const double gain = std::max(kGyroBiasGain, 1.0 / static_cast<double>(bias_updates + 2));
  ++bias_updates;
  gyro_bias = (gyro_bias + gain * error).cwiseMax(-kMaxGyroBias).cwiseMin(kMaxGyroBias);
}

void Odometry::State::update_prediction_error() {
  const SE3 error = prediction_error();
  const Vector3 turn = so3_log(error.rotation);
  Vector6 squares;
  squares << error.translation.cwiseAbs2(), turn.cwiseAbs2();
  // Increases at once, decays exponentially; unobserved axes do not contribute.
  const Vector6 expected = prediction_error_variance.cwiseProduct(registration.observability);
  prediction_error_variance =
      squares.cwiseMax(prediction_error_variance + (1.0 - kErrorMemory) * (squares - expected));
  prediction_error_m = metres_of(error);
  // The initial value counts as one scan.
  sigma_scans = std::min(sigma_scans + 1, kGuessIsForgotten);
  const double memory = std::min(kErrorMemory, 1.0 - 1.0 / (sigma_scans + 1));
  const double square = memory * sigma_m * sigma_m + (1.0 - memory) * prediction_error_m * prediction_error_m;
  sigma_m = std::clamp(std::sqrt(square), kMinSigmaMetres, kMaxSigmaMetres);
}

/// Observability of the translation along each axis, 0 to 1.
Vector3 Odometry::State::translation_observability() const {
  Vector3 share = registration.observability.head<3>();
  for (int axis = 0; axis < 3; ++axis) {
    if ((registration.degenerate_axes >> axis & 1) != 0) share[axis] = 0.0;
  }
  return share;
}

void Odometry::State::update_inertial_velocity() {
  if (accelerometer_observes_motion()) {
    inertial_velocity.update(turn_rate(motion_prior.imu_used), registered_motion(), measured_twist.head<3>(),
                             translation_observability(), motion_prior.acceleration.has_value());
  } else {
    inertial_velocity.interrupt();
  }
}

/// Skips a motion that is no evidence about the IMU.
void Odometry::State::skip_motion() {
  monitor.skip();
  inertial_velocity.interrupt();
}

void Odometry::State::update_motion() {
  update_inertial_velocity();
  const bool is_shifted = monitor.observe(imu, gyro_bias, registered_motion());
  update_gyro_bias();
  if (is_shifted) {
    imu.clear();
    inertial_velocity.interrupt();
  }
  update_prediction_error();
  update_velocity();
}

void Odometry::State::update_velocity() {
  if (scans < kInitialScans) {
    twist.reset(measured_twist);
  } else {
    twist.update(measured_twist, registration.observability, measured_step());
  }
  if (motion_prior.is_stationary && scans == 1 && measured_twist.head<3>().norm() > kStartSpeedError)
    static_initialization.end();
  if (motion_prior.is_stationary && !static_initialization.is_over()) {
    twist.stand();
    inertial_velocity.set_gravity_bias(
        registration.T_map_moving.rotation * static_initialization.mean_force(),
        kStationaryGravityBiasVariance);
  } else if (motion_prior.acceleration) {
    correct_motion_filter();
  } else {
    motion_filter.forget();
  }
}

void Odometry::State::correct_motion_filter() {
  const Vector3 moved = prediction_error().translation;
  const Vector3 change = motion_filter.correct(T_predicted.rotation.toRotationMatrix(), moved,
                                               registration.observability.head<3>());
  inertial_velocity.set_gravity_bias(inertial_velocity.consistency().gravity_bias() + change,
                                     motion_filter.gravity_bias_variance());
  if (motion_filter.is_contradicted()) reset_motion_filter();
}

void Odometry::State::reset_motion_filter() {
  inertial_velocity.reset();
  motion_filter.forget();
}

void Odometry::State::reset_prediction_error() {
  sigma_m = kMaxSigmaMetres;
  sigma_scans = 0;
}

void Odometry::State::count_coarse_scan() {
  if (coarse_scans_left == 0) return;
  coarse_scans_left = registration.degenerate_axes == 0 ? coarse_scans_left - 1 : kScansToBeSure;
}

void Odometry::State::accept(OdometryResult& result) {
  if (relocalized) {
    skip_motion();
    motion_filter.forget();
    // A displacement that the accelerometer did not observe invalidates its velocity.
    if (exceeds_motion_limits()) inertial_velocity.reset();
    reset_prediction_error();
  } else {
    update_motion();
  }
  if (!motion_compensated) result.deskew_rate = deskew_rate;
  doubtful = !is_in_family() || relocalized;
  const double memory = mean_agreement == 0.0 ? 0.0 : kAgreementMemory;
  if (!doubtful) mean_agreement = memory * mean_agreement + (1.0 - memory) * agreement();
  doubts = doubtful ? doubts + 1 : 0;
  if (!doubtful) relocalization_attempts = 0;
  failures = 0;
  recovers = false;
  count_coarse_scan();
  const double span_s = motion_prior.span_s();
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
  motion.predict(expected_twist(motion_prior).head<3>());
  twist.hold(measured_step());
  T_map_base = T_predicted;
  sigma_m = std::min(kMaxSigmaMetres, 2.0 * sigma_m);
  result.predicted = true;
  result.stop_reason = registration.stop_reason == StopReason::kConverged ? StopReason::kDegenerate
                       : sweep.empty() && budget.was_short()              ? StopReason::kBudget
                                                                          : registration.stop_reason;
  // A budget too small for tracking is no reason to exceed it.
  recovers = result.stop_reason != StopReason::kBudget || result.recovery_budget.ns > 0;
  result.state = state_without_registration();
}

void Odometry::State::check_registration(OdometryResult& result) {
  const bool is_tracked = !relocalized && has_converged();
  if (is_plausible() && (is_tracked || is_in_family() || !exceeds_motion_limits())) {
    accept(result);
  } else {
    fall_back(result);
  }
}

}  // namespace nilio::core
