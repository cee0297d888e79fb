#include "core/src/odometry_impl.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

constexpr double kStationaryGravityVariance = 0.02 * 0.02;
// Unknown acceleration and tilt of a moving start, m/s^2.
constexpr double kMovingGravityVariance = 1.5 * 1.5;

}  // namespace

Odometry::State::MotionPrior Odometry::State::motion_prior_for(const Scan& scan) const {
  MotionPrior result;
  result.previous = time;
  result.span = {scan.motion_compensated ? scan.end : scan.start, scan.end};
  const Time from = std::min(motion_filter.state().time, result.span.start);
  result.imu_covers =
      (scans > 0 || motion_is_known) && imu.covers(from, scan.end - kMaxImuLag, config.max_imu_gap);
  result.inputs.imu = &imu;
  result.inputs.imu_position = config.T_base_imu.translation;
  result.inputs.gyro = result.imu_covers && monitor.usable(from, scan.end);
  result.inputs.speed_is_observed = (registration.degenerate_axes & 1U) == 0;
  result.inputs.gyro_is_verified = monitor.is_verified();
  result.inputs.accelerometer = result.imu_covers && gravity_known && monitor.force_usable(from) &&
                                scan.end >= accelerometer_banned_until;
  return result;
}

bool Odometry::State::detect_stationary() {
  if (motion_prior.imu_covers && monitor.force_usable(motion_prior.previous)) {
    const Time end = motion_prior.span.end;
    return stationary_detector.observe(imu_statistics(imu, end - StationaryDetector::kWindow, end),
                                       motion_filter.may_be_stationary());
  }
  if (stationary_detector.is_stationary() || scans >= kInitialScans) stationary_detector.end();
  return false;
}

/// Gravity from the mean specific force, where nothing better is known.
void Odometry::State::initialize_gravity() {
  if (gravity_known || !motion_prior.imu_covers || motion_prior.span.end < accelerometer_banned_until) return;
  const Time from = motion_filter.state().time;
  const Time to = std::min(motion_prior.span.middle(), *imu.latest());
  if (to <= from) return;
  motion_filter.set_gravity(motion_filter.state().T_map_base.rotation * mean_specific_force(imu, from, to),
                            kMovingGravityVariance);
  gravity_known = true;
}

/// The IMU was wrong, and with it the gravity that it gave.
void Odometry::State::end_stationary() {
  stationary_detector.contradict();
  motion_prior.is_stationary = false;
  gravity_known = false;
}

double Odometry::State::prediction_deviation() const {
  const Matrix6 covariance = motion_filter.pose_covariance();
  const double square = covariance.topLeftCorner<3, 3>().trace() +
                        kErrorLeverMetres * kErrorLeverMetres * covariance.bottomRightCorner<3, 3>().trace();
  return std::clamp(std::sqrt(square), kMinSigmaMetres, kMaxSigmaMetres);
}

void Odometry::State::predict_motion() {
  motion_filter.propagate(motion_prior.inputs, motion_prior.span.middle());
  if (motion_prior.is_stationary) {
    if (stationary_detector.is_first() || !stationary_detector.has_begun())
      motion_filter.zero_motion_update(T_stationary);
    else
      motion_filter.zero_velocity_update();
  }
  follow(motion_filter.state());
  T_predicted = motion_filter.state().T_map_base;
  sigma_m = prediction_deviation();
}

/// The sweep's motion from the state at its midpoint.
void Odometry::State::follow(const MotionState& state) {
  motion = SweepMotion(motion_prior.span, state, motion_prior.inputs);
}

void Odometry::State::predict(const Scan& scan, OdometryResult& result) {
  motion_prior = motion_prior_for(scan);
  initialize_gravity();
  relocalized = false;
  motion_prior.is_stationary = detect_stationary();
  if (scans == 1) T_stationary = T_map_base;
  if (motion_prior.is_stationary && stationary_detector.is_first()) {
    motion_filter.set_gravity(motion_filter.state().T_map_base.rotation * stationary_detector.mean_force(),
                              scans > 1 ? kStationaryGravityVariance : kMovingGravityVariance);
    gravity_known = true;
  }
  last_filter = motion_filter;
  predict_motion();
  result.imu_used = motion_prior.inputs.gyro;
}

}  // namespace nilio::core
