#include "odometry_state.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nilio::core {

namespace {

// Enough to tell a right pose from a wrong one, where many are tried.
constexpr std::size_t kStartPoints = 250;
// From here ICP finds the pose; the one that is kept is registered once more.
constexpr CoarseEpsilon kSearchEpsilon{0.1, 0.01};
// Start: speeds to look at along the vehicle's axis, as displacements a scan: -20 to 50 m/s at 10 Hz. Of
// those that look likely, so many are tried, and not two that lead to the same place.
constexpr double kLeastStartDisplacementMetres = -2.0;
constexpr double kStartStepMetres = 1.0;
constexpr std::size_t kStartDisplacements = 8;
constexpr int kStartTrials = 2;
constexpr double kSamePlaceMetres = 1.25;

// Where to look for a lost vehicle: turned, and ahead of or behind the prediction. NDT reaches 3 m and 10 deg
// from each.
struct Hypothesis {
  double forward_m;
  double yaw_rad;
};
constexpr std::array<Hypothesis, 7> kLostHypotheses = {
    {{0.0, 0.0}, {0.0, 0.17}, {0.0, -0.17}, {0.0, 0.35}, {0.0, -0.35}, {4.0, 0.0}, {-4.0, 0.0}}};
// What NDT takes from one of them, about.
constexpr std::size_t kSearchIterations = 15;

}  // namespace

void thin_evenly(const std::vector<Eigen::Vector3f>& points, std::size_t target,
                 std::vector<Eigen::Vector3f>& output) {
  output.clear();
  const std::size_t count = std::min(target, points.size());
  for (std::size_t i = 0; i < count; ++i) output.push_back(points[i * points.size() / count]);
}

void Odometry::State::try_hypothesis(const SE3& T_guess, Search& search, OdometryResult& result) {
  RegistrationResult coarse;
  coarse.T_map_moving = T_guess;
  if (method.coarse)
    coarse = register_coarsely(coarse_map, search_points, T_guess, config.max_coarse_iterations, &budget,
                               kSearchEpsilon);
  const RegistrationResult fine =
      register_fine(search_points, coarse.T_map_moving, plane_metric(sigma_m), std::nullopt, result);
  result.coarse_iterations += coarse.iterations;
  if (!fine.T_map_moving.is_finite() || fine.equations.inliers <= search.inliers) return;
  search.inliers = fine.equations.inliers;
  search.T_best = fine.T_map_moving;
}

SE3 Odometry::State::start_hypothesis(std::size_t i) const {
  const double displacement = kLeastStartDisplacementMetres + kStartStepMetres * static_cast<double>(i);
  return T_predicted * SE3{Eigen::Quaterniond::Identity(), Vector3(displacement, 0.0, 0.0)};
}

void Odometry::State::register_from_standstill(OdometryResult& result) {
  // Nothing is known of the speed: look at many along the vehicle's axis, register from the likeliest and
  // keep what most points agree with.
  motion.deskew(sweep, deskewed);
  thin_evenly(deskewed, kStartPoints, search_points);
  std::array<double, kStartDisplacements> scores{};
  for (std::size_t i = 0; i < scores.size(); ++i)
    scores[i] =
        ndt_equations(coarse_map, search_points, start_hypothesis(i), {kNdtKernelSchedule[0]}).weight_sum;
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
  registration.T_map_moving = search.T_best;
  refine_motion(search.T_best);
}

SE3 Odometry::State::lost_hypothesis(std::size_t i) const {
  // It may have stopped where it was seen last.
  if (i == 0) return T_accepted;
  const Hypothesis& h = kLostHypotheses[i - 1];
  return T_predicted * SE3{Eigen::Quaterniond(Eigen::AngleAxisd(h.yaw_rad, Vector3::UnitZ())),
                           Vector3(h.forward_m, 0.0, 0.0)};
}

/// The pose that was registered from the prediction stays unless one that is searched for agrees with the map
/// better; where no vehicle can have driven to, it has to agree as well as while tracking. Elsewhere it is
/// motion like any other.
void Odometry::State::compare_hypotheses(OdometryResult& result) {
  const bool was_relocated = relocated;
  const RegistrationResult tracked = registration;
  const SweepMotion tracked_motion = motion;
  const double tracked_agreement = has_pose() ? agreement() : 0.0;
  const std::size_t tracked_points = registered_points;
  if (!was_relocated) {
    register_anew(result);
    if (has_pose() && is_in_family() && is_drivable(prediction_error(), ahead.span_s())) return;
  }
  search_lost_vehicle(result);
  register_points(false, plane_metric(kMinSigmaMetres), result);
  const bool is_motion = !was_relocated && is_drivable(prediction_error(), ahead.span_s());
  if (!has_converged() || agreement() <= tracked_agreement || !(is_motion || is_in_family())) {
    relocated = was_relocated;
    registration = tracked;
    motion = tracked_motion;
    registered_points = tracked_points;
  } else if (is_motion) {
    relocated = false;
    register_points(false, plane_metric(sigma_m), result);
  }
  count_inliers(result);
}

/// From the prediction as if it were worth as little as after a gap.
void Odometry::State::register_anew(OdometryResult& result) {
  registration = {};
  registration.T_map_moving = T_map_base * motion.predict(expected_twist(ahead).head<3>());
  select_points(registration.T_map_moving);
  register_points(method.coarse, plane_metric(kMaxSigmaMetres), result);
  count_inliers(result);
}

void Odometry::State::search_lost_vehicle(OdometryResult& result) {
  relocated = true;
  motion.predict(expected_twist(ahead).head<3>());
  motion.deskew(sweep, deskewed);
  const bool has_time = budget.allows(Work::kNdt, kSearchIterations * kCoarsePoints);
  thin_evenly(deskewed, has_time ? kCoarsePoints : kStartPoints, search_points);
  Search search{T_predicted, 0};
  // What this scan has no time for, the next ones look at.
  for (std::size_t tried = 0; tried <= kLostHypotheses.size(); ++tried) {
    if (!budget.allows(Work::kNdt, kSearchIterations * search_points.size())) break;
    try_hypothesis(lost_hypothesis(next_hypothesis), search, result);
    next_hypothesis = (next_hypothesis + 1) % (kLostHypotheses.size() + 1);
    if (tried == kLostHypotheses.size()) ++searches;
  }
  registration.T_map_moving = search.T_best;
  // The points were chosen for the pose that was wrong.
  select_points(search.T_best);
}

}  // namespace nilio::core
