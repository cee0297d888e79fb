#include "core/src/odometry_impl.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nilio::core {

namespace {

// Points per hypothesis, enough to rank hypotheses.
constexpr std::size_t kStartPoints = 250;
// Convergence thresholds within the basin of ICP; the best pose is registered again.
constexpr CoarseEpsilon kSearchEpsilon{0.1, 0.01};
// Initial velocity search: displacements along the vehicle's axis for -20 to 50 m/s at 10 Hz; the best few
// that are not the same place are registered.
constexpr double kMinStartDisplacementMetres = -2.0;
constexpr double kStartStepMetres = 1.0;
constexpr std::size_t kStartDisplacements = 8;
constexpr int kStartTrials = 2;
constexpr double kSamePlaceMetres = 1.25;
// Error of a found displacement, with a sweep that is not deskewed.
constexpr double kFoundDeviationMetres = 0.3;
constexpr double kFoundDeviationRadians = 0.01;

// Relocalisation hypotheses around the prediction. NDT converges from 3 m and 10 deg around each.
struct Offset {
  double forward_m;
  double yaw_rad;
};
constexpr std::array<Offset, 7> kRelocalizationHypotheses = {
    {{0.0, 0.0}, {0.0, 0.17}, {0.0, -0.17}, {0.0, 0.35}, {0.0, -0.35}, {4.0, 0.0}, {-4.0, 0.0}}};
// Typical number of NDT iterations for a hypothesis.
constexpr std::size_t kSearchIterations = 15;

}  // namespace

void sample_evenly(const std::vector<Eigen::Vector3f>& points, std::size_t target,
                   std::vector<Eigen::Vector3f>& output) {
  output.clear();
  const std::size_t count = std::min(target, points.size());
  for (std::size_t i = 0; i < count; ++i) output.push_back(points[i * points.size() / count]);
}

void Odometry::State::try_hypothesis(const SE3& T_guess, Search& search, OdometryResult& result) {
  RegistrationResult coarse;
  coarse.T_map_moving = T_guess;
  if (method.coarse)
    coarse = register_coarsely(ndt_map, search_points, T_guess, config.max_coarse_iterations, &budget,
                               kSearchEpsilon);
  const RegistrationResult fine =
      register_fine(search_points, coarse.T_map_moving, plane_metric(sigma_m), std::nullopt, result);
  result.coarse_iterations += coarse.iterations;
  if (!fine.T_map_moving.is_finite() || fine.equations.inliers <= search.inliers) return;
  search.inliers = fine.equations.inliers;
  search.T_best = fine.T_map_moving;
}

SE3 Odometry::State::start_hypothesis(std::size_t i) const {
  const double displacement = kMinStartDisplacementMetres + kStartStepMetres * static_cast<double>(i);
  return T_predicted * SE3{Eigen::Quaterniond::Identity(), Vector3(displacement, 0.0, 0.0)};
}

void Odometry::State::find_initial_velocity(OdometryResult& result) {
  // The speed is unknown: scores displacements along the axis, registers the best ones, keeps the one with
  // most inliers.
  motion.deskew(sweep, deskewed);
  sample_evenly(deskewed, kStartPoints, search_points);
  std::array<double, kStartDisplacements> scores{};
  for (std::size_t i = 0; i < scores.size(); ++i)
    scores[i] =
        ndt_equations(ndt_map, search_points, start_hypothesis(i), {kNdtKernelSchedule[0]}).weight_sum;
  Search search{T_predicted, 0};
  for (int trial = 0; trial < kStartTrials; ++trial) {
    const auto best =
        static_cast<std::size_t>(std::max_element(scores.begin(), scores.end()) - scores.begin());
    try_hypothesis(start_hypothesis(best), search, result);
    for (std::size_t i = 0; i < scores.size(); ++i) {
      const double distance = kStartStepMetres * std::abs(static_cast<double>(i) - static_cast<double>(best));
      if (distance < kSamePlaceMetres) scores[i] = 0.0;
    }
  }
  if (motion_prior.is_stationary) {
    // Other vehicles suggest speeds to a stationary one.
    const std::uint32_t stationary =
        plane_equations(planes, search_points, T_stationary, plane_metric(kMinSigmaMetres)).inliers;
    if (stationary > kAgreementCollapse * search.inliers)
      search.T_best = T_stationary;
    else
      end_stationary();
  }
  start_moving(search.T_best);
}

/// The velocity found for the second scan; the first map is built again with it.
void Odometry::State::start_moving(const SE3& T_map_middle) {
  const double seconds = (motion_prior.span.middle() - last_middle).seconds();
  const Vector6 twist = se3_log(T_map_last_middle.inverse() * T_map_middle) / seconds;
  Vector6 variance;
  variance << Vector3::Constant(kFoundDeviationMetres * kFoundDeviationMetres / (seconds * seconds)),
      Vector3::Constant(kFoundDeviationRadians * kFoundDeviationRadians / (seconds * seconds));
  motion_filter = last_filter;
  motion_filter.set_twist(twist, variance);
  if (!motion_compensated) rebuild_first_map();
  predict_motion();
  registration.T_map_moving = T_predicted;
}

SE3 Odometry::State::relocalization_hypothesis(std::size_t i) const {
  // The vehicle may have stopped at the last registered pose.
  if (i == 0) return T_accepted * motion.T_middle_end().inverse();
  const Offset& h = kRelocalizationHypotheses[i - 1];
  return T_predicted * SE3{so3_exp(h.yaw_rad * Vector3::UnitZ()), Vector3(h.forward_m, 0.0, 0.0)};
}

/// The tracked pose stays unless a relocalised one converged and agrees better with the map; a pose that no
/// vehicle can have driven to must also agree as well as while tracking. A reachable one counts as motion.
void Odometry::State::compare_hypotheses(OdometryResult& result) {
  const bool was_relocated = relocalized;
  const RegistrationResult tracked = registration;
  const SweepMotion tracked_motion = motion;
  const double tracked_agreement = has_pose() ? agreement() : 0.0;
  const std::size_t tracked_points = registered_points;
  if (!was_relocated) {
    register_anew(result);
    if (has_pose() && is_in_family() && is_drivable(prediction_error(), motion_prior.span_s())) return;
  }
  relocalize(result);
  register_points(false, plane_metric(kMinSigmaMetres), result);
  const bool is_motion = !was_relocated && is_drivable(prediction_error(), motion_prior.span_s());
  // An IMU that measured the motion says how far the vehicle can be.
  const bool is_reachable = !motion_prior.inputs.measure_motion() ||
                            motion_filter.squared_distance(registration.T_map_moving) < kFarInnovation;
  if (!has_converged() || agreement() <= tracked_agreement || !is_reachable ||
      !(is_motion || is_in_family())) {
    relocalized = was_relocated;
    registration = tracked;
    motion = tracked_motion;
    registered_points = tracked_points;
  } else if (is_motion) {
    relocalized = false;
    register_points(false, metric_of_prediction(), result);
  }
  count_inliers(result);
}

/// Registers again with the wide gate and NDT, as after a gap.
void Odometry::State::register_anew(OdometryResult& result) {
  registration = {};
  follow(motion_filter.state());
  registration.T_map_moving = T_predicted;
  select_points(registration.T_map_moving);
  register_points(method.coarse, plane_metric(kMaxSigmaMetres), result);
  count_inliers(result);
}

void Odometry::State::relocalize(OdometryResult& result) {
  relocalized = true;
  follow(motion_filter.state());
  motion.deskew(sweep, deskewed);
  const bool has_time = budget.allows(WorkKind::kNdt, kSearchIterations * kCoarsePoints);
  sample_evenly(deskewed, has_time ? kCoarsePoints : kStartPoints, search_points);
  Search search{T_predicted, 0};
  // Hypotheses without time in this scan are continued in the next one.
  for (std::size_t tried = 0; tried <= kRelocalizationHypotheses.size(); ++tried) {
    if (!budget.allows(WorkKind::kNdt, kSearchIterations * search_points.size())) break;
    try_hypothesis(relocalization_hypothesis(next_hypothesis), search, result);
    next_hypothesis = (next_hypothesis + 1) % (kRelocalizationHypotheses.size() + 1);
    if (tried == kRelocalizationHypotheses.size()) ++relocalization_attempts;
  }
  registration.T_map_moving = search.T_best;
  // Points were selected at the rejected pose.
  select_points(search.T_best);
}

}  // namespace nilio::core
