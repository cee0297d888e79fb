#include "nilio/core/portable_math.hpp"

#include "core/src/odometry_impl.hpp"
#include "core/src/registration/gauss_newton.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

constexpr double kPeriodMemory = 0.9;
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
// The accelerometer is left out for a while after innovations beyond three standard deviations over some
// scans.
constexpr double kInnovationMemory = 0.8;
constexpr double kMaxInnovation = 9.0;
constexpr Duration kAccelerometerBan = Duration::from_seconds(5.0);

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
  if (!has_pose() || motion.end_twist().head<3>().norm() > kMaxSpeed ||
      motion.end_twist().tail<3>().norm() > kMaxTurnRate)
    return false;
  // A relocalised pose must be a local optimum.
  return !relocalized || has_converged();
}

/// Whether the registered pose is where the filter expects it.
bool Odometry::State::fits_prediction() const {
  return motion_filter.normalised_innovation_squared(registration.T_map_moving, registration.information) <
         kFarInnovation;
}

/// Whether the prediction shows the place behind a gap to a voxel of the map, and the scan does not
/// contradict it.
bool Odometry::State::bridges_gap() const {
  return is_gap(motion_prior.span_s()) && !relocalized && kGateSigmas * sigma_m < plane_voxel_m &&
         fits_prediction();
}

/// Mean agreement of the points with the map. A new view of half of the scene is normal; beyond, unknown
/// places agree with nothing, unless the prediction leads there over a gap.
double Odometry::State::agreement() const {
  if (registered_points == 0) return 0.0;
  double seen_before = mean_known_share > 0.0 ? std::min(1.0, 2.0 * known_share / mean_known_share) : 1.0;
  if (seen_before < 1.0 && bridges_gap()) seen_before = 1.0;
  return seen_before * registration.equations.agreement / static_cast<double>(registered_points);
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
  const double reach =
      std::min(kMaxSpeed, published_speed + kMaxAcceleration * seconds) * seconds + kScanErrorMetres;
  return step.translation.norm() <= reach &&
         so3_log(step.rotation).norm() <= kMaxTurnRate * seconds + kScanErrorMetres;
}

/// Outlier: beyond both the recent prediction errors and the acceleration limits.
bool Odometry::State::exceeds_motion_limits() const {
  const SE3 error = prediction_error();
  if (scans < kInitialScans || metres_of(error) < kGateSigmas * sigma_m) return false;
  return !is_drivable(error, motion_prior.span_s() * (failures + 1));
}

/// Skips a motion that is no evidence about the IMU.
void Odometry::State::skip_motion() { monitor.skip(); }

/// An accelerometer that scans keep contradicting has wrong gravity, axes or units.
void Odometry::State::weigh_accelerometer(double innovation_squared) {
  if (!motion_prior.inputs.accelerometer) return;
  accelerometer_innovations =
      kInnovationMemory * accelerometer_innovations + (1.0 - kInnovationMemory) * innovation_squared / 6.0;
  if (accelerometer_innovations < kMaxInnovation) return;
  accelerometer_innovations = 0.0;
  accelerometer_banned_until = motion_prior.span.end + kAccelerometerBan;
  gravity_known = false;
}

void Odometry::State::update_motion() {
  prediction_error_m = metres_of(prediction_error());
  weigh_accelerometer(
      motion_filter.normalised_innovation_squared(registration.T_map_moving, registration.information));
  if (registration.sweep_information.isZero())
    motion_filter.update(registration.T_map_moving, registration.information);
  else
    motion_filter.update(registration.T_map_moving, registration.twist, registration.sweep_information);
  const Duration shift = monitor.time_shift();
  monitor.observe(imu, motion_filter.state().gyro_bias, registered_motion());
  if (monitor.time_shift() != shift) imu.move_stamps(shift - monitor.time_shift());
}

/// A pose that recovery found: a measurement as any other where it is as expected.
void Odometry::State::relocate_motion() {
  skip_motion();
  if (fits_prediction()) {
    motion_filter.update(registration.T_map_moving, registration.information);
  } else {
    motion_filter.relocate(registration.T_map_moving);
  }
}

void Odometry::State::count_coarse_scan() {
  if (coarse_scans_left == 0) return;
  coarse_scans_left = registration.degenerate_axes == 0 ? coarse_scans_left - 1 : kScansToBeSure;
}

void Odometry::State::accept(OdometryResult& result) {
  // Of the prediction, which the update replaces.
  const double agreed = agreement();
  // A hidden view does not move a stationary vehicle.
  doubtful =
      (!is_in_family() && !motion_prior.is_stationary) || relocalized || (failures > 0 && !has_converged());
  if (relocalized) {
    relocate_motion();
  } else {
    update_motion();
  }
  if (stationary_detector.has_begun() && !stationary_detector.is_first())
    T_stationary = motion_filter.state().T_map_base;
  follow(motion_filter.state());
  if (!motion_compensated) result.deskew_rate = motion_filter.state().angular_velocity;
  const double memory = mean_agreement == 0.0 ? 0.0 : kAgreementMemory;
  if (!doubtful) {
    mean_agreement = memory * mean_agreement + (1.0 - memory) * agreed;
    // Behind a gap the map begins anew.
    const double known_memory = is_gap(motion_prior.span_s()) ? 0.0 : memory;
    mean_known_share = known_memory * mean_known_share + (1.0 - known_memory) * known_share;
  }
  doubts = doubtful ? doubts + 1 : 0;
  if (!doubtful) relocalization_attempts = 0;
  failures = 0;
  recovers = false;
  count_coarse_scan();
  const double span_s = motion_prior.span_s();
  period_s = scans == 1 ? span_s : kPeriodMemory * period_s + (1.0 - kPeriodMemory) * span_s;
  T_map_base = motion_filter.state().T_map_base * motion.T_middle_end();
  T_accepted = T_map_base;
  result.stop_reason = registration.stop_reason;
  result.degenerate_axes = registration.degenerate_axes;
  const bool is_degraded = (registration.degenerate_axes != 0 && !motion_prior.is_stationary) || doubtful;
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
  follow(motion_filter.state());
  T_map_base = T_predicted * motion.T_middle_end();
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
