#include "core/src/odometry_impl.hpp"

namespace nilio::core {

namespace {

// Error of the rotation beside PoseSearch::kDeviationMetres.
constexpr double kFoundDeviationRadians = 0.01;
// A tight corner at walking pace, rad/s.
constexpr double kTriedTurnRate = 0.5;

Vector6 variances(double speed, double turn_rate) {
  Vector6 deviations;
  deviations << Vector3::Constant(speed), Vector3::Constant(turn_rate);
  return deviations.cwiseAbs2();
}

}  // namespace

Odometry::State::Hypothesis Odometry::State::hypothesis() const {
  return {motion.hypothesis(), alignment, gate.agreement(alignment, motion)};
}

void Odometry::State::return_to(const Hypothesis& earlier, OdometryResult& result) {
  motion.return_to(earlier.motion);
  alignment = earlier.alignment;
  alignment.count(result);
}

/// The speed at the second scan is unknown, and its rotation without a gyro: the stationary vehicle, which
/// registration does not find among moving objects, and the motions found from several speeds are kept until
/// one is left. An IMU that says that the vehicle is stationary must be refuted.
void Odometry::State::find_initial_motions(OdometryResult& result) {
  const bool seems_stationary = motion.prior().is_stationary;
  const bool has_coarse = ndt_icp.method().coarse;
  motion.assume_stationary(true);
  begin_with(motion.twist_to(motion.T_stationary()), has_coarse, result);
  initial_motions.add(motion.hypothesis(), alignment);
  motion.assume_stationary(false);
  // A velocity that is not known yet distorts both sweeps alike.
  place_with(Vector6::Zero(), variances(0.5 * InitialMotions::kSpeedStep, kTriedTurnRate));
  const SE3 T_map_first = motion.T_map_last_middle();
  const double seconds = motion.seconds_since_last_middle();
  const auto displaced = search.find_displacements(preprocessing.sweep(), map, motion, result);
  for (const SE3& found : displaced) {
    if (&found != &displaced.front() && !budget.allows_hypothesis()) break;
    begin_with(se3_log(T_map_first.inverse() * found) / seconds, has_coarse, result);
    initial_motions.add(motion.hypothesis(), alignment);
  }
  initial_motions.drop_equal();
  refine_initial_motions(result);
  if (seems_stationary && !initial_motions.keep_stationary()) motion.end_stationary();
  initial_motions.keep_likely();
  refine_initial_motions(result);
  keep_likely_motions(result);
}

/// The error of a tried velocity distorts both sweeps; that of the registered one is small.
void Odometry::State::refine_initial_motions(OdometryResult& result) {
  for (InitialMotion& found : initial_motions.motions()) {
    if (found.motion.prior.is_stationary || !found.alignment.has_pose()) continue;
    if (!budget.allows_hypothesis()) return;
    const SE3 T_first_second = found.earlier[0].T_map_middle.inverse() * found.alignment.pose();
    const Vector6 twist = se3_log(T_first_second) / motion.seconds_since_last_middle();
    begin_with(twist, found.alignment.by_ndt, result);
    initial_motions.replace(found, motion.hypothesis(), alignment);
  }
}

/// Places the first sweep, and predicts the second, with this initial velocity.
void Odometry::State::place_with(const Vector6& twist, const Vector6& variance) {
  motion.set_last_twist(twist, variance);
  if (!motion.prior().motion_compensated) place_first_sweep(map.plane_voxel_m());
  motion.predict_again();
}

/// Registers the second scan with this initial velocity.
void Odometry::State::begin_with(const Vector6& twist, bool coarse, OdometryResult& result) {
  const double seconds = motion.seconds_since_last_middle();
  place_with(twist, variances(PoseSearch::kDeviationMetres / seconds, kFoundDeviationRadians / seconds));
  ndt_icp.select(preprocessing.sweep(), motion.motion(), map, motion.T_predicted(), coarse);
  align({motion.T_predicted(), metric_of(motion.filter()), coarse}, result);
}

/// Registers a scan after each motion that the scans before may have had, with the map that they give with
/// it.
void Odometry::State::follow_initial_motions(OdometryResult& result) {
  if (motion.prior().is_stationary) {
    initial_motions.keep_first();
    return align_to_prediction(result);
  }
  for (InitialMotion& followed : initial_motions.motions()) {
    if (&followed != &initial_motions.motions().front() && !budget.allows_hypothesis()) {
      initial_motions.keep_before(followed);
      break;
    }
    place_sweeps(followed);
    motion.predict_after(followed.motion.filter, followed.motion.gravity_known);
    register_at_prediction(result);
    followed.motion = motion.hypothesis();
    followed.alignment = alignment;
  }
  keep_likely_motions(result);
}

void Odometry::State::keep_likely_motions(OdometryResult& result) {
  initial_motions.keep_likely();
  const InitialMotion& best = initial_motions.motions().front();
  place_sweeps(best);
  motion.return_to(best.motion);
  alignment = best.alignment;
  alignment.count(result);
  if (!initial_motions.are_decided()) initial_motions.end_scan(preprocessing.sweep());
}

void Odometry::State::place_sweeps(const InitialMotion& placed) {
  map.reset(map.plane_voxel_m());
  const auto sweeps = initial_motions.sweeps();
  for (std::size_t i = 0; i < sweeps.size(); ++i) insert(sweeps[i], placed.earlier[i]);
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
