#include "core/src/odometry_impl.hpp"

#include <algorithm>
#include <array>

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

/// The speed at the second scan is unknown, but for a stationary vehicle. The vehicle is slow unless more
/// points agree with one of the motions found, or many more where the IMU says that it is stationary.
void Odometry::State::find_initial_velocity(OdometryResult& result) {
  const bool is_stationary = motion.prior().is_stationary;
  const auto poses = search.find_displacements(preprocessing.sweep(), map, motion, result);
  std::array<Vector6, PoseSearch::kDisplacementTrials> twists;
  std::transform(poses.begin(), poses.end(), twists.begin(),
                 [&](const FoundPose& found) { return motion.twist_to(found.T_map_middle); });
  const auto is_slow = [&](const Vector6& twist) {
    return twist.head<3>().norm() * motion.seconds_since_last_middle() < kFoundDeviationMetres;
  };
  const auto found_slow = std::find_if(twists.begin(), twists.end(), is_slow);
  Vector6 slow = Vector6::Zero();
  if (is_stationary) {
    slow = motion.twist_to(motion.T_stationary());
  } else if (found_slow != twists.end()) {
    slow = *found_slow;
  }
  begin_with(slow, result);
  const MotionEstimator::Hypothesis at_rest = motion.hypothesis();
  double most = alignment.agreement() / (is_stationary ? kAgreementCollapse : 1.0);
  Vector6 best = slow;
  Vector6 last = slow;
  for (const Vector6& found : twists) {
    if (is_slow(found)) continue;
    if (motion.prior().is_stationary) motion.predict_moving();
    begin_with(last = found, result);
    if (!alignment.has_pose()) continue;
    // The error of a found velocity distorts both sweeps; that of the registered one is small.
    last = motion.twist_to(alignment.pose());
    begin_with(last, result);
    if (alignment.agreement() <= most) continue;
    most = alignment.agreement();
    best = last;
  }
  if (is_stationary && best == slow) motion.return_to(at_rest);
  if (is_stationary && best != slow) motion.end_stationary();
  if (last != best) begin_with(best, result);
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
/// registered without it, and what agrees better with the map, by more than chance, is kept.
void Odometry::State::reconsider_imu(OdometryResult& result) {
  if (!motion.prior().inputs.gyro) return;
  const bool is_contradicted =
      is_plausible(alignment, motion) && motion.contradicts_gyro(alignment.registration);
  if (!is_contradicted && !gate.is_doubtful(alignment, motion)) return;
  const Hypothesis with_imu = hypothesis();
  motion.predict_without_imu();
  register_at_prediction(result);
  if (!is_plausible(alignment, motion) ||
      (!is_contradicted && !gate.agrees_better(alignment, motion, with_imu.agreement)))
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
  if (!alignment.has_converged() || !gate.agrees_better(alignment, motion, tracked_agreement) ||
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
