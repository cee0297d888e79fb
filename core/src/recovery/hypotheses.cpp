#include "core/src/odometry_impl.hpp"

namespace nilio::core {

namespace {

// Error of a found displacement, with a sweep that is not deskewed.
constexpr double kFoundDeviationMetres = 0.3;
constexpr double kFoundDeviationRadians = 0.01;

}  // namespace

Odometry::State::Hypothesis Odometry::State::hypothesis() const {
  return {motion.hypothesis(), alignment, gate.agreement(alignment, motion)};
}

void Odometry::State::return_to(const Hypothesis& earlier, OdometryResult& result) {
  motion.return_to(earlier.motion);
  alignment = earlier.alignment;
  alignment.count(result);
}

/// The speed at the second scan is unknown, but for a stationary vehicle. The one found and that of a vehicle
/// at rest are tried, unless they are the same: it is at rest unless more points, or a larger share, agree
/// with the motion.
void Odometry::State::find_initial_velocity(OdometryResult& result) {
  const SE3 moved = motion.T_map_last_middle().inverse() * search_displacement(result);
  const Vector6 twist = se3_log(moved) / motion.seconds_since_last_middle();
  begin_with(twist, result);
  if (motion.prior().is_stationary || moved.translation.norm() < kFoundDeviationMetres) return;
  const Hypothesis moving = hypothesis();
  begin_with(Vector6::Zero(), result);
  if (moving.alignment.agreement() > alignment.agreement() ||
      moving.agreement > gate.agreement(alignment, motion))
    begin_with(twist, result);
}

/// Registers the second scan with this initial velocity. The first map is built again with it.
void Odometry::State::begin_with(const Vector6& twist, OdometryResult& result) {
  const double seconds = motion.seconds_since_last_middle();
  Vector6 deviation;
  deviation << Vector3::Constant(kFoundDeviationMetres), Vector3::Constant(kFoundDeviationRadians);
  motion.set_last_twist(twist, deviation.cwiseAbs2() / (seconds * seconds));
  if (!motion.prior().motion_compensated) place_first_sweep(map.plane_voxel_m());
  motion.predict_again();
  register_at_prediction(result);
}

SE3 Odometry::State::search_displacement(OdometryResult& result) {
  const FoundPose found = search.find_displacement(preprocessing.sweep(), map, motion, result);
  if (!motion.prior().is_stationary) return found.T_map_middle;
  // Other vehicles suggest speeds to a stationary one.
  if (search.inliers_at(motion.T_stationary(), map) > kAgreementCollapse * found.inliers)
    return motion.T_stationary();
  motion.end_stationary();
  return found.T_map_middle;
}

/// Other vehicles move the scan of a stationary one, and the IMU does not see a smooth walking pace: the
/// vehicle is stationary unless the map agrees much better with a motion.
void Odometry::State::reconsider_stationary(OdometryResult& result) {
  if (!motion.prior().is_stationary || motion.scans() == 1) return;
  if (motion.fits(alignment.registration)) return;
  const Hypothesis stationary = hypothesis();
  motion.predict_moving();
  register_at_prediction(result);
  if (is_plausible(alignment, motion) &&
      kAgreementCollapse * gate.agreement(alignment, motion) > stationary.agreement) {
    motion.end_stationary();
  } else {
    return_to(stationary, result);
  }
}

/// A wrong IMU distorts the scan by deskewing and holds the pose: where the two do not agree, the scan is
/// registered without it, and what agrees better with the map is kept.
void Odometry::State::reconsider_imu(OdometryResult& result) {
  if (!motion.prior().inputs.gyro) return;
  const bool is_contradicted =
      is_plausible(alignment, motion) && motion.contradicts_gyro(alignment.registration);
  if (!is_contradicted && !gate.is_doubtful(alignment, motion)) return;
  const Hypothesis with_imu = hypothesis();
  motion.predict_without_imu();
  register_at_prediction(result);
  if (!is_plausible(alignment, motion) ||
      (!is_contradicted && gate.agreement(alignment, motion) <= with_imu.agreement))
    return return_to(with_imu, result);
  result.imu_used = false;
  if (is_contradicted || motion.contradicts_gyro(alignment.registration)) motion.demote_imu();
}

/// The tracked pose stays unless a relocalised one converged and agrees better with the map; a pose that no
/// vehicle can have driven to must also agree as well as while tracking. A reachable one counts as motion.
void Odometry::State::compare_hypotheses(OdometryResult& result) {
  const Alignment tracked = alignment;
  const SweepMotion tracked_motion = motion.motion();
  const double tracked_agreement = gate.agreement(alignment, motion);
  const auto is_motion = [&] {
    return is_drivable_deviation(motion.prediction_error(alignment.pose()), motion.prior().span_s());
  };
  align_anew(result);
  if (alignment.has_pose() && gate.is_in_family(alignment, motion) && is_motion()) return;
  relocalize(result);
  if (!alignment.has_converged() || gate.agreement(alignment, motion) <= tracked_agreement ||
      !motion.may_reach(alignment.pose()) || !(is_motion() || gate.is_in_family(alignment, motion))) {
    alignment = tracked;
    motion.return_to(tracked_motion);
  } else if (is_motion()) {
    align({alignment.pose(), metric_of(motion.filter())}, result);
  }
  alignment.count(result);
}

/// Registers again with the wide gate and NDT, as after a gap.
void Odometry::State::align_anew(OdometryResult& result) {
  motion.follow_prediction();
  select_points(motion.T_predicted());
  align({motion.T_predicted(), plane_metric(kMaxSigmaMetres), ndt_icp.method().coarse}, result);
}

void Odometry::State::relocalize(OdometryResult& result) {
  motion.follow_prediction();
  const FoundPose found = search.relocalize(preprocessing.sweep(), map, motion, result);
  if (search.has_tried_all()) gate.count_search();
  // Points were selected at the rejected pose.
  select_points(found.T_map_middle);
  align({found.T_map_middle, plane_metric(kMinSigmaMetres), false, true}, result);
}

}  // namespace nilio::core
