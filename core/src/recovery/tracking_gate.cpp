#include "core/src/recovery/tracking_gate.hpp"

#include "nilio/core/portable_math.hpp"
#include "nilio/core/units.hpp"

#include "core/src/registration/gauss_newton.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

constexpr double kAgreementMemory = 0.95;
// Number of predicted poses, and of poses out of family, in a row until the state is lost.
constexpr int kLostAfterFailures = 5;
constexpr int kLostAfterDoubts = 8;
// Predicted poses, and failed relocalisations, in a row until the map is reset.
constexpr int kRestartAfterFailures = 30;
constexpr int kRestartAfterSearches = 10;
// NDT runs until this many scans observed every axis; after one that did not, until this many in a row do:
// moving objects must not determine the initial velocity.
constexpr int kMinScansWithNdt = 4;
constexpr int kScansToBeSure = 20;
constexpr double kCoarseTriggerErrorMetres = 0.5;
// Maximum speed and turn rate of a road vehicle.
constexpr double kMaxSpeed = 90.0;
constexpr double kMaxTurnRate = 6.0;
// Maximum acceleration, short of an accident.
constexpr double kMaxAcceleration = 50.0;
constexpr double kMaxTurnAcceleration = 10.0;
// Time over which tracking vouches for the motion: after a jump poses are lost, after an uncertain one and
// behind a gap over which the map ended they are degraded.
constexpr Duration kVouchedTime = Duration::from_seconds(1.0);

// Error of the motion over that time; beyond it the benchmark counts a silent error.
constexpr double kMotionErrorMetres = 0.10;
constexpr double kMotionErrorShare = 0.02;
constexpr double kMotionErrorRadians = kRadiansPerDegree;

/// Whether the motion between two such poses, a second apart, is known as tracking promises.
bool is_certain(const PublishedPose& pose) {
  const auto is_known = [&](const Matrix3& covariance, double allowed) {
    return kGateSigmas * std::sqrt(2.0 * covariance.trace()) <= allowed;
  };
  const double allowed_m = kMotionErrorMetres + kMotionErrorShare * pose.speed_m_s * kVouchedTime.seconds();
  return is_known(pose.covariance.topLeftCorner<3, 3>(), allowed_m) &&
         is_known(pose.covariance.bottomRightCorner<3, 3>(), kMotionErrorRadians);
}

bool is_within(const std::optional<Time>& event, Time stamp) {
  return event && stamp - *event < kVouchedTime;
}

/// Maximum displacement of a point at the lever.
double metres_of(const SE3& error) {
  const double angle = so3_log(error.rotation).norm();
  return error.translation.norm() + 2.0 * kErrorLeverMetres * portable::sin(0.5 * angle);
}

}  // namespace

bool is_plausible(const Alignment& alignment, const MotionEstimator& motion) {
  const Vector6& twist = motion.motion().end_twist();
  if (!alignment.has_pose() || twist.head<3>().norm() > kMaxSpeed || twist.tail<3>().norm() > kMaxTurnRate)
    return false;
  return !alignment.relocalized || alignment.has_converged();
}

double chance_of_agreement(const Alignment& alignment) {
  if (alignment.points == 0) return 0.0;
  const double mean = alignment.mean_agreement();
  return kGateSigmas * std::sqrt(std::max(0.0, mean * (1.0 - mean)) / static_cast<double>(alignment.points));
}

bool is_drivable_deviation(const SE3& deviation, double seconds) {
  return deviation.translation.norm() <= kMaxAcceleration * seconds * seconds &&
         so3_log(deviation.rotation).norm() <= kMaxTurnAcceleration * seconds * seconds;
}

TrackingGate::TrackingGate(const OdometryConfig& config, const RegistrationMethodInfo& method)
    : coarse_policy_(config.coarse), has_coarse_(method.coarse), coarse_scans_left_(kMinScansWithNdt) {}

void TrackingGate::begin_map(double plane_voxel_m) {
  plane_voxel_m_ = plane_voxel_m;
  former_agreement_ = mean_agreement_;
  mean_agreement_ = 0.0;
  mean_known_share_ = 0.0;
  prediction_error_m_ = 0.0;
  coarse_scans_left_ = kMinScansWithNdt;
  doubts_ = 0;
  failures_ = 0;
  searches_ = 0;
}

bool TrackingGate::restart_is_due(const MotionEstimator& motion) const {
  const bool has_not_begun = failures_ > 0 && motion.is_initialising();
  return has_not_begun || elsewhere_at_ == motion.prior().span.end || failures_ >= kRestartAfterFailures ||
         searches_ >= kRestartAfterSearches;
}

bool TrackingGate::coarse_is_due(const MotionEstimator& motion) const {
  if (!has_coarse_) return false;
  if (coarse_policy_ == CoarsePolicy::kAlways || coarse_scans_left_ > 0 || failures_ > 0) return true;
  return std::max(prediction_error_m_, motion.deviation_m()) > kCoarseTriggerErrorMetres ||
         motion.prior().is_gap;
}

/// Whether the prediction shows the place behind a gap to a voxel of the map, and the scan does not
/// contradict it.
bool TrackingGate::bridges_gap(const Alignment& alignment, const MotionEstimator& motion) const {
  return motion.prior().is_gap && !alignment.relocalized &&
         kGateSigmas * motion.deviation_m() < plane_voxel_m_ && motion.fits(alignment.registration);
}

/// Share of the scene that the map knows, 1 down to half of what it usually knows: a new view of half of the
/// scene is normal.
double TrackingGate::seen_before(const Alignment& alignment) const {
  return mean_known_share_ > 0.0 ? std::min(1.0, 2.0 * alignment.known_share / mean_known_share_) : 1.0;
}

/// Unknown places agree with nothing, unless the prediction leads there over a gap.
double TrackingGate::agreement(const Alignment& alignment, const MotionEstimator& motion) const {
  if (alignment.points == 0 || !alignment.has_pose()) return 0.0;
  double seen = seen_before(alignment);
  if (seen < 1.0 && bridges_gap(alignment, motion)) seen = 1.0;
  return seen * alignment.agreement() / static_cast<double>(alignment.points);
}

bool TrackingGate::agrees_better(const Alignment& alignment, const MotionEstimator& motion,
                                 double other) const {
  return agreement(alignment, motion) - chance_of_agreement(alignment) > other;
}

bool TrackingGate::begins_in_family(const Alignment& alignment, const MotionEstimator& motion) const {
  return is_usual(alignment, motion, former_agreement_);
}

bool TrackingGate::is_in_family(const Alignment& alignment, const MotionEstimator& motion) const {
  return motion.is_initialising() || is_usual(alignment, motion, mean_agreement_);
}

/// Few points disagree by chance.
bool TrackingGate::is_usual(const Alignment& alignment, const MotionEstimator& motion, double usual) const {
  return agreement(alignment, motion) + chance_of_agreement(alignment) > kAgreementCollapse * usual;
}

bool TrackingGate::is_doubtful(const Alignment& alignment, const MotionEstimator& motion) const {
  const double usual = motion.is_initialising() ? 0.0 : mean_agreement_;
  return !is_plausible(alignment, motion) || agreement(alignment, motion) < kAgreementCollapse * usual;
}

/// Outlier: beyond both the recent prediction errors and the acceleration limits.
bool TrackingGate::exceeds_motion_limits(const Alignment& alignment, const MotionEstimator& motion) const {
  const SE3 error = motion.prediction_error(alignment.pose());
  if (motion.is_initialising() || metres_of(error) < kGateSigmas * motion.deviation_m()) return false;
  return !is_drivable_deviation(error, motion.prior().span_s() * (failures_ + 1));
}

/// A gap after which the prediction does not tell the place leads to one that the map does not know: the map
/// is reset there, and the motion goes on, before a scan that follows other vehicles can end it.
bool TrackingGate::leads_elsewhere(const Alignment& alignment, const MotionEstimator& motion) const {
  return motion.prior().is_known_gap && motion.deviation_m() >= kMaxSigmaMetres &&
         seen_before(alignment) < 1.0 && !is_in_family(alignment, motion);
}

bool TrackingGate::accepts(const Alignment& alignment, const MotionEstimator& motion) const {
  const bool is_tracked = !alignment.relocalized && alignment.has_converged();
  return is_plausible(alignment, motion) &&
         (is_tracked || is_in_family(alignment, motion) || !exceeds_motion_limits(alignment, motion));
}

TrackingState TrackingGate::accept(const Alignment& alignment, const MotionEstimator& motion) {
  const RegistrationResult& registration = alignment.registration;
  const bool is_stationary = motion.prior().is_stationary;
  // A hidden view does not move a stationary vehicle.
  doubtful_ = (!is_in_family(alignment, motion) && !is_stationary) || alignment.relocalized ||
              (failures_ > 0 && !alignment.has_converged());
  if (leads_elsewhere(alignment, motion)) elsewhere_at_ = motion.prior().span.end;
  const double memory = mean_agreement_ == 0.0 ? 0.0 : kAgreementMemory;
  if (!doubtful_) {
    mean_agreement_ = memory * mean_agreement_ + (1.0 - memory) * agreement(alignment, motion);
    // Behind a gap the map begins anew.
    const double known_memory = motion.prior().is_gap ? 0.0 : memory;
    mean_known_share_ = known_memory * mean_known_share_ + (1.0 - known_memory) * alignment.known_share;
    searches_ = 0;
  }
  if (!alignment.relocalized) prediction_error_m_ = metres_of(motion.prediction_error(alignment.pose()));
  doubts_ = doubtful_ ? doubts_ + 1 : 0;
  failures_ = 0;
  recovers_ = false;
  if (coarse_scans_left_ > 0)
    coarse_scans_left_ = registration.degenerate_axes == 0 ? coarse_scans_left_ - 1 : kScansToBeSure;
  if (motion.is_initialising()) return TrackingState::kInitialising;
  if (doubts_ >= kLostAfterDoubts) return TrackingState::kLost;
  const bool was_elsewhere = is_within(elsewhere_at_, motion.prior().previous);
  const bool is_degraded = (registration.degenerate_axes != 0 && !is_stationary) || alignment.only_ndt ||
                           doubtful_ || was_elsewhere;
  return is_degraded ? TrackingState::kDegraded : TrackingState::kTracking;
}

TrackingState TrackingGate::fail(const Alignment& alignment, const MotionEstimator& motion,
                                 bool for_lack_of_time) {
  if (!for_lack_of_time && leads_elsewhere(alignment, motion)) elsewhere_at_ = motion.prior().span.end;
  ++failures_;
  ++doubts_;
  recovers_ = !for_lack_of_time;
  return state_without_registration(motion, motion.filter(), 0);
}

TrackingState TrackingGate::state_without_registration(const MotionEstimator& motion,
                                                       const MotionFilter& predicted,
                                                       int scans_to_come) const {
  if (motion.is_initialising()) return TrackingState::kInitialising;
  const bool is_unknown = deviation_at_lever(predicted.pose_covariance()) >= kMaxSigmaMetres;
  return is_unknown || failures_ + scans_to_come >= kLostAfterFailures ? TrackingState::kLost
                                                                       : TrackingState::kDegraded;
}

bool TrackingGate::is_drivable_step(const PublishedPose& pose) const {
  const SE3 step = T_published_.inverse() * pose.T_map_base;
  const double reach =
      std::min(kMaxSpeed, published_speed_m_s_ + kMaxAcceleration * pose.seconds) * pose.seconds +
      kScanErrorMetres;
  return step.translation.norm() <= reach &&
         so3_log(step.rotation).norm() <= kMaxTurnRate * pose.seconds + kScanErrorMetres;
}

TrackingState TrackingGate::published_state(const PublishedPose& pose, TrackingState state) const {
  if (state == TrackingState::kInitialising) return state;
  if (is_within(jumped_at_, pose.stamp) || !is_drivable_step(pose)) return TrackingState::kLost;
  const bool is_uncertain = is_within(uncertain_at_, pose.stamp) || !is_certain(pose);
  return state == TrackingState::kTracking && is_uncertain ? TrackingState::kDegraded : state;
}

void TrackingGate::publish(const PublishedPose& pose, TrackingState state) {
  if (state != TrackingState::kInitialising) {
    if (!is_drivable_step(pose)) jumped_at_ = pose.stamp;
    if (!is_certain(pose)) uncertain_at_ = pose.stamp;
  }
  T_published_ = pose.T_map_base;
  published_speed_m_s_ = pose.speed_m_s;
}

}  // namespace nilio::core
