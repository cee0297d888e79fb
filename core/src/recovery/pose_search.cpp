#include "core/src/recovery/pose_search.hpp"

#include "core/src/prefault.hpp"
#include "core/src/recovery/initial_motions.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nilio::core {

namespace {

// Points per hypothesis, enough to rank hypotheses, and more where there is time.
constexpr std::size_t kFewPoints = 250;
constexpr std::size_t kManyPoints = 800;

// Relocalisation hypotheses around the prediction. NDT converges from 3 m and 10 deg around each.
struct Offset {
  double forward_m;
  double yaw_rad;
};
constexpr std::array<Offset, 7> kOffsets = {
    {{0.0, 0.0}, {0.0, 0.17}, {0.0, -0.17}, {0.0, 0.35}, {0.0, -0.35}, {4.0, 0.0}, {-4.0, 0.0}}};
constexpr std::size_t kHypotheses = kOffsets.size() + 1;
// Typical number of NDT iterations for a hypothesis.
constexpr std::size_t kSearchIterations = 15;

/// The vehicle may have stopped at the last registered pose, or be near the predicted one.
SE3 hypothesis(std::size_t i, const MotionEstimator& motion) {
  if (i == 0) return motion.T_accepted() * motion.motion().T_middle_end().inverse();
  const Offset& offset = kOffsets[i - 1];
  return motion.T_predicted() *
         SE3{so3_exp(offset.yaw_rad * Vector3::UnitZ()), Vector3(offset.forward_m, 0.0, 0.0)};
}

}  // namespace

PoseSearch::PoseSearch(const OdometryConfig& config, NdtIcp& ndt_icp, ComputeBudget& budget)
    : ndt_icp_(ndt_icp), budget_(budget) {
  prefault(config.max_filtered_points, deskewed_);
  prefault(kManyPoints, points_);
  prefault(InitialMotions::kSpeeds.size(), displaced_);
}

void PoseSearch::sample(const std::vector<SweepPoint>& sweep, const MotionEstimator& motion,
                        std::size_t count) {
  motion.motion().deskew(sweep, deskewed_);
  sample_evenly(deskewed_, count, points_);
}

void PoseSearch::try_hypothesis(const SE3& T_map_hypothesis, const LocalMap& map,
                                const MotionEstimator& motion, FoundPose& best, OdometryResult& result) {
  const RegistrationResult found =
      ndt_icp_.align_roughly(map, points_, T_map_hypothesis, motion.deviation_m(), result);
  if (!found.T_map_moving.is_finite() || found.equations.inliers <= best.inliers) return;
  best = {found.T_map_moving, found.equations.inliers};
}

FoundPose PoseSearch::relocalize(const std::vector<SweepPoint>& sweep, const LocalMap& map,
                                 const MotionEstimator& motion, OdometryResult& result) {
  const bool has_time = budget_.allows(WorkKind::kNdt, kSearchIterations * kManyPoints);
  sample(sweep, motion, has_time ? kManyPoints : kFewPoints);
  FoundPose best{motion.T_predicted(), 0};
  has_tried_all_ = false;
  for (std::size_t tried = 0; tried < kHypotheses; ++tried) {
    if (!budget_.allows(WorkKind::kNdt, kSearchIterations * points_.size())) return best;
    try_hypothesis(hypothesis(next_hypothesis_, motion), map, motion, best, result);
    next_hypothesis_ = (next_hypothesis_ + 1) % kHypotheses;
  }
  has_tried_all_ = true;
  return best;
}

std::span<const SE3> PoseSearch::find_displacements(const std::vector<SweepPoint>& sweep, const LocalMap& map,
                                                    const MotionEstimator& motion, OdometryResult& result) {
  sample(sweep, motion, kFewPoints);
  displaced_.clear();
  for (const double speed : InitialMotions::kSpeeds) {
    if (!displaced_.empty() && !budget_.allows_hypothesis()) break;
    const Vector3 displacement(speed * motion.seconds_since_last_middle(), 0.0, 0.0);
    const RegistrationResult found = ndt_icp_.register_roughly(
        map, points_, motion.T_predicted() * SE3{Eigen::Quaterniond::Identity(), displacement},
        motion.deviation_m(), result);
    const auto is_near = [&](const SE3& other) {
      return (other.translation - found.T_map_moving.translation).norm() < kDeviationMetres;
    };
    if (has_found_pose(found) && std::none_of(displaced_.begin(), displaced_.end(), is_near))
      displaced_.push_back(found.T_map_moving);
  }
  if (displaced_.empty()) displaced_.push_back(motion.T_predicted());
  return displaced_;
}

}  // namespace nilio::core
