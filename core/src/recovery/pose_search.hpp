#pragma once

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/odometry_config.hpp"
#include "nilio/core/odometry_result.hpp"

#include "core/src/estimation/motion_estimator.hpp"
#include "core/src/map/local_map.hpp"
#include "core/src/registration/ndt_icp.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace nilio::core {

/// Pose of the midpoint of a sweep that registers with the most inliers.
struct FoundPose {
  SE3 T_map_middle;
  std::uint32_t inliers = 0;
};

/// Searches the pose of a scan where the prediction is no guide: hypotheses are registered with few points,
/// and the one with most inliers is kept. Not thread-safe.
class PoseSearch {
 public:
  /// Error of a displacement found with sweeps that were deskewed with another velocity.
  static constexpr double kDeviationMetres = 0.3;

  /// `ndt_icp` and `budget` must outlive it.
  PoseSearch(const OdometryConfig& config, NdtIcp& ndt_icp, ComputeBudget& budget);

  /// Second scan of a map, at an unknown speed: where it registers, from speeds along the vehicle's axis;
  /// each place once.
  std::span<const SE3> find_displacements(const std::vector<SweepPoint>& sweep, const LocalMap& map,
                                          const MotionEstimator& motion, OdometryResult& result);
  /// Scan of a lost vehicle: the pose around prediction and last pose. Hypotheses for which there is no time
  /// are continued in the next call.
  FoundPose relocalize(const std::vector<SweepPoint>& sweep, const LocalMap& map,
                       const MotionEstimator& motion, OdometryResult& result);
  /// Whether the last call tried all hypotheses.
  [[nodiscard]] bool has_tried_all() const { return has_tried_all_; }

 private:
  void sample(const std::vector<SweepPoint>& sweep, const MotionEstimator& motion, std::size_t count);
  void try_hypothesis(const SE3& T_map_hypothesis, const LocalMap& map, const MotionEstimator& motion,
                      FoundPose& best, OdometryResult& result);

  NdtIcp& ndt_icp_;
  ComputeBudget& budget_;
  std::size_t next_hypothesis_ = 0;
  bool has_tried_all_ = false;
  std::vector<Eigen::Vector3f> deskewed_;
  std::vector<Eigen::Vector3f> points_;
  std::vector<SE3> displaced_;
};

}  // namespace nilio::core
