#include "core/src/estimation/motion_estimator.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

constexpr double kStationaryGravityVariance = 0.02 * 0.02;
constexpr double kMovingGravityVariance = MotionFilter::kGravityPrior * MotionFilter::kGravityPrior;
constexpr double kStillForceDeviation = 0.5;
// Velocities of a vehicle that is not stationary after all, m/s and rad/s.
constexpr double kWalkingSpeed = 2.0;
// A pass of registration is repeated if the end of the sweep moves by more than registration resolves.
constexpr double kMotionEpsilonMetres = 2.5e-3;
constexpr double kMotionEpsilonRadians = 2.5e-4;
// Acceleration that tyres can transmit, m/s^2.
constexpr double kTyreAcceleration = 10.0;
// Bits of RegistrationResult::degenerate_axes.
constexpr std::uint8_t kRotationAxes = 0b111000;
constexpr double kPeriodMemory = 0.9;
constexpr double kGapPeriods = 1.5;

}  // namespace

double deviation_at_lever(const Matrix6& pose_covariance) {
  const double square =
      pose_covariance.topLeftCorner<3, 3>().trace() +
      kErrorLeverMetres * kErrorLeverMetres * pose_covariance.bottomRightCorner<3, 3>().trace();
  return std::clamp(std::sqrt(square), kMinSigmaMetres, kMaxSigmaMetres);
}

MotionFilter updated(MotionFilter predicted, const RegistrationResult& registration) {
  const SE3& T_map_middle = registration.T_map_moving;
  if (registration.sweep_information.isZero())
    predicted.update(T_map_middle, registration.information);
  else
    predicted.update(T_map_middle, registration.twist, registration.sweep_information);
  return predicted;
}

MotionEstimator::MotionEstimator(const OdometryConfig& config)
    : T_base_imu_(config.T_base_imu),
      max_imu_gap_(config.max_imu_gap),
      imu_(config.imu_capacity),
      monitor_({config.T_base_imu.translation, config.max_imu_gap}) {}

bool MotionEstimator::add_imu(const ImuSample& sample) {
  ImuSample in_lidar_time = sample;
  in_lidar_time.stamp = sample.stamp - monitor_.time_shift();
  if (!imu_.add(in_lidar_time, T_base_imu_.rotation)) return false;
  monitor_.add(sample);
  return true;
}

void MotionEstimator::level(const Scan& scan) {
  const ImuStatistics statistics = imu_statistics(imu_, scan.start, scan.end);
  if (statistics.count < 2 || statistics.acceleration_deviation > kStillForceDeviation) return;
  if (!is_gravity_plausible(statistics.mean_acceleration)) return;
  T_odom_map_.rotation = Eigen::Quaterniond::FromTwoVectors(statistics.mean_acceleration, Vector3::UnitZ());
}

void MotionEstimator::leave_map() {
  const bool is_known = motion_goes_on_ || !is_initialising();
  motion_goes_on_ = is_known && (prior_.inputs.measure_motion() || prior_.is_known_gap);
  if (is_initialising() && !motion_goes_on_) T_map_base_ = T_accepted_;
  scans_ = 0;
  speed_is_observed_ = true;
  stationary_detector_.end();
}

Matrix6 MotionEstimator::start(const Scan& scan) {
  prior_ = prior_for(scan);
  filter_.move_clock(scan.clock_step);
  const Time middle = prior_.span.middle();
  if (motion_goes_on_) filter_.propagate(prior_.inputs, middle);
  const Matrix6 covariance = filter_.pose_covariance();
  if (!motion_goes_on_) {
    filter_.reset(T_map_base_, middle);
    gravity_known_ = false;
  } else {
    filter_.begin_map();
    follow_prediction();
    T_map_base_ = filter_.state().T_map_base * motion_.T_middle_end();
  }
  last_filter_ = filter_;
  deviation_m_ = kMaxSigmaMetres;
  T_predicted_ = T_map_base_;
  T_accepted_ = T_map_base_;
  return covariance;
}

void MotionEstimator::place_first_sweep(const SweepSpan& span) {
  // The gyro has not been tested yet.
  MotionState state = filter_.state();
  state.time = span.middle();
  motion_ = SweepMotion(span, state, {});
  const SE3 T_map_middle = T_map_base_ * motion_.T_middle_end().inverse();
  filter_.set_pose(T_map_middle);
  last_filter_.set_pose(T_map_middle);
}

MotionPrior MotionEstimator::prior_for(const Scan& scan) const {
  MotionPrior result;
  result.previous = prior_.span.end + scan.clock_step;
  result.span = {scan.motion_compensated ? scan.end : scan.start, scan.end};
  result.is_gap = is_behind_gap(scan);
  const bool is_time_known = !scan.after_time_jump || scan.clock_step.ns > 0;
  // The second scan tells how far scans are apart.
  result.is_known_gap = result.is_gap && is_time_known && scans_ > 1;
  result.motion_compensated = scan.motion_compensated;
  const Time from = std::min(filter_.state().time + scan.clock_step, result.span.start);
  result.imu_covers =
      (scans_ > 0 || motion_goes_on_) && imu_.covers(from, scan.end - kMaxImuLag, max_imu_gap_);
  result.inputs.imu = &imu_;
  result.inputs.imu_position = T_base_imu_.translation;
  result.inputs.gyro = result.imu_covers && monitor_.usable(from, scan.end);
  result.inputs.speed_is_observed = speed_is_observed_;
  result.inputs.gyro_scale_deviation = monitor_.scale_deviation();
  result.inputs.accelerometer = result.imu_covers && gravity_known_ && monitor_.force_usable(from);
  return result;
}

bool MotionEstimator::is_behind_gap(const Scan& scan) const {
  return (scan.end - scan.clock_step - prior_.span.end).seconds() > kGapPeriods * period_s_;
}

bool MotionEstimator::detect_stationary() {
  if (prior_.imu_covers && monitor_.force_usable(prior_.previous)) {
    const Time end = prior_.span.end;
    return stationary_detector_.observe(imu_statistics(imu_, end - StationaryDetector::kWindow, end),
                                        filter_.may_be_stationary());
  }
  if (stationary_detector_.is_stationary() || !is_initialising()) stationary_detector_.end();
  return false;
}

/// Gravity from the mean specific force, where nothing better is known.
void MotionEstimator::initialise_gravity() {
  if (gravity_known_ || !prior_.imu_covers || !monitor_.force_usable(prior_.previous)) return;
  const Time from = filter_.state().time;
  const Time to = std::min(prior_.span.middle(), *imu_.latest());
  if (to <= from) return;
  const Vector3 force = mean_specific_force(imu_, from, to);
  if (!is_gravity_plausible(force)) return;
  filter_.set_gravity(filter_.state().T_map_base.rotation * force, kMovingGravityVariance);
  gravity_known_ = true;
}

void MotionEstimator::end_stationary() {
  stationary_detector_.contradict();
  prior_.is_stationary = false;
  gravity_known_ = false;
}

void MotionEstimator::predict(const Scan& scan) {
  prior_ = prior_for(scan);
  filter_.move_clock(scan.clock_step);
  initialise_gravity();
  prior_.is_stationary = detect_stationary();
  if (scans_ == 1) T_stationary_ = T_map_base_;
  if (prior_.is_stationary && stationary_detector_.is_first()) {
    filter_.set_gravity(filter_.state().T_map_base.rotation * stationary_detector_.mean_force(),
                        scans_ > 1 ? kStationaryGravityVariance : kMovingGravityVariance);
    gravity_known_ = true;
  }
  last_filter_ = filter_;
  predict_again();
}

void MotionEstimator::predict_again() {
  filter_.propagate(prior_.inputs, prior_.span.middle());
  if (prior_.is_stationary) {
    if (stationary_detector_.is_first() || !stationary_detector_.has_begun())
      filter_.zero_motion_update(T_stationary_);
    else
      filter_.zero_velocity_update();
  }
  follow_prediction();
  T_predicted_ = filter_.state().T_map_base;
  deviation_m_ = deviation_at_lever(filter_.pose_covariance());
}

void MotionEstimator::predict_after(const MotionFilter& earlier, bool gravity_known) {
  filter_ = earlier;
  filter_.move_clock(last_filter_.state().time - earlier.state().time);
  gravity_known_ = gravity_known;
  initialise_gravity();
  prior_.inputs.accelerometer = false;
  last_filter_ = filter_;
  predict_again();
}

void MotionEstimator::set_last_twist(const Vector6& twist, const Vector6& variance) {
  filter_ = last_filter_;
  filter_.set_twist(twist, variance);
}

void MotionEstimator::predict_without_imu() {
  prior_.inputs.gyro = prior_.inputs.accelerometer = false;
  filter_ = last_filter_;
  predict_again();
}

void MotionEstimator::predict_moving() {
  prior_.is_stationary = false;
  set_last_twist(Vector6::Zero(), Vector6::Constant(kWalkingSpeed * kWalkingSpeed));
  predict_again();
}

bool MotionEstimator::follow(const RegistrationResult& registration) {
  const SE3 T_middle_end = motion_.T_middle_end();
  const MotionState state = registration.sweep_information.isZero()
                                ? filter_.conditioned_on(registration.T_map_moving)
                                : filter_.conditioned_on(registration.T_map_moving, registration.twist);
  motion_ = SweepMotion(prior_.span, state, prior_.inputs);
  const SE3 change = T_middle_end.inverse() * motion_.T_middle_end();
  return change.translation.norm() < kMotionEpsilonMetres &&
         so3_log(change.rotation).norm() < kMotionEpsilonRadians;
}

void MotionEstimator::follow_prediction() {
  motion_ = SweepMotion(prior_.span, filter_.state(), prior_.inputs);
}

bool MotionEstimator::widen_for_manoeuvre(const SE3& T_map_middle) {
  if (!filter_.adapt_to_manoeuvre(T_map_middle, prior_.inputs)) return false;
  const MotionFilter adapted = filter_;
  filter_ = last_filter_;
  filter_.adapt_as(adapted);
  filter_.propagate(prior_.inputs, prior_.span.middle());
  return true;
}

void MotionEstimator::return_to(const Hypothesis& earlier) {
  prior_ = earlier.prior;
  last_filter_ = earlier.last_filter;
  filter_ = earlier.filter;
  motion_ = earlier.motion;
  gravity_known_ = earlier.gravity_known;
  T_predicted_ = filter_.state().T_map_base;
  deviation_m_ = deviation_at_lever(filter_.pose_covariance());
}

bool MotionEstimator::fits(const RegistrationResult& registration) const {
  return filter_.normalised_innovation_squared(registration.T_map_moving, registration.information) <
         kFarInnovation;
}

/// Beside an IMU that measured the motion the filter tells. Without one tyres do behind a gap, whose duration
/// is not known where a clock was set.
bool MotionEstimator::may_reach(const SE3& T_map_middle) const {
  if (prior_.inputs.measure_motion()) return filter_.squared_distance(T_map_middle) < kFarInnovation;
  if (!prior_.is_known_gap) return true;
  const double seconds = prior_.span_s();
  return prediction_error(T_map_middle).translation.norm() <= 0.5 * kTyreAcceleration * seconds * seconds;
}

RegisteredMotion MotionEstimator::motion_to(const RegistrationResult& registration) const {
  return {last_filter_.state().time, prior_.span.middle(), T_map_last_middle(), registration.T_map_moving,
          (registration.degenerate_axes & kRotationAxes) == 0};
}

bool MotionEstimator::contradicts_gyro(const RegistrationResult& registration) const {
  return monitor_.contradicts(imu_, filter_.state().gyro_bias, motion_to(registration));
}

/// An IMU whose predictions scans contradict in one direction is left out until turns prove it.
void MotionEstimator::observe_innovation(const RegistrationResult& registration) {
  if (!prior_.inputs.measure_motion()) return;
  innovation_bias_.add(filter_.weighted_innovation(registration.T_map_moving, registration.information));
  if (!innovation_bias_.is_significant()) return;
  innovation_bias_ = {};
  gravity_known_ = false;
  monitor_.demote();
}

void MotionEstimator::update(const RegistrationResult& registration) {
  observe_innovation(registration);
  filter_ = updated(filter_, registration);
  const Duration shift = monitor_.time_shift();
  monitor_.observe(imu_, filter_.state().gyro_bias, motion_to(registration));
  if (monitor_.time_shift() != shift) imu_.move_stamps(shift - monitor_.time_shift());
  settle();
}

void MotionEstimator::relocate(const RegistrationResult& registration) {
  monitor_.skip();
  if (fits(registration)) {
    filter_.update(registration.T_map_moving, registration.information);
  } else {
    filter_.relocate(registration.T_map_moving);
  }
  settle();
}

void MotionEstimator::settle() {
  if (stationary_detector_.has_begun() && !stationary_detector_.is_first())
    T_stationary_ = filter_.state().T_map_base;
  follow_prediction();
  const double span_s = prior_.span_s();
  period_s_ = scans_ == 1 ? span_s : kPeriodMemory * period_s_ + (1.0 - kPeriodMemory) * span_s;
  T_map_base_ = filter_.state().T_map_base * motion_.T_middle_end();
  T_accepted_ = T_map_base_;
  level_odom();
}

/// Turns `odom` against the tilt of the map, around the vehicle, whose place in it stays.
void MotionEstimator::level_odom() {
  const Eigen::Quaterniond turn = so3_exp(filter_.take_tilt());
  const Vector3& place = T_map_base_.translation;
  T_odom_map_ = T_odom_map_ * SE3{turn, place - turn * place};
}

void MotionEstimator::coast() {
  monitor_.skip();
  follow_prediction();
  T_map_base_ = T_predicted_ * motion_.T_middle_end();
}

void MotionEstimator::finish(std::uint8_t degenerate_axes) {
  speed_is_observed_ = (degenerate_axes & 1U) == 0;
  ++scans_;
}

double MotionEstimator::seconds_since_last_middle() const {
  return (prior_.span.middle() - last_filter_.state().time).seconds();
}

Vector6 MotionEstimator::twist_to(const SE3& T_map_middle) const {
  return se3_log(T_map_last_middle().inverse() * T_map_middle) / seconds_since_last_middle();
}

}  // namespace nilio::core
