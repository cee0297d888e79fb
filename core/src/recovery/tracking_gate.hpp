#pragma once

#include "nilio/core/odometry_config.hpp"
#include "nilio/core/tracking.hpp"

#include "core/src/estimation/motion_estimator.hpp"
#include "core/src/registration/ndt_icp.hpp"

#include <optional>

namespace nilio::core {

/// Share of the usual agreement with the map, or of that of another hypothesis, below which one is out of
/// family.
inline constexpr double kAgreementCollapse = 0.75;

/// A pose that leaves the odometry.
struct PublishedPose {
  SE3 T_map_base;
  Time stamp;
  double seconds = 0.0;  ///< since the last one
  double speed_m_s = 0.0;
  /// Covariance of the pose at the midpoint of the sweep, where the scan shows it: m^2, rad^2.
  Matrix6 covariance = Matrix6::Zero();
};

/// Decides whether a registration is accepted and what is said about the pose: by the agreement of the points
/// with the map, compared with the usual one, and by the motion limits of a vehicle. Not thread-safe.
class TrackingGate {
 public:
  TrackingGate(const OdometryConfig& config, const RegistrationMethodInfo& method);

  /// A new map, with planes in voxels of this size.
  void begin_map(double plane_voxel_m);
  /// Whether the map is to be reset: it failed at its beginning, a gap led away from it, or relocalisation
  /// failed for long.
  [[nodiscard]] bool restart_is_due(const MotionEstimator& motion) const;
  /// Whether NDT runs before ICP.
  [[nodiscard]] bool coarse_is_due(const MotionEstimator& motion) const;
  /// The last scan was accepted at once.
  [[nodiscard]] bool is_tracking() const { return failures_ == 0; }
  [[nodiscard]] bool last_failed() const { return recovers_; }
  /// The map may take the last scan.
  [[nodiscard]] bool vouches() const { return failures_ == 0 && !doubtful_; }

  // Evidence about an alignment of the scan that `motion` predicts.
  /// Mean agreement of the points with the map, 0 to 1; 0 without a pose.
  [[nodiscard]] double agreement(const Alignment& alignment, const MotionEstimator& motion) const;
  /// Whether it agrees better than another alignment did, by more than chance.
  [[nodiscard]] bool agrees_better(const Alignment& alignment, const MotionEstimator& motion,
                                   double other) const;
  /// Whether the second scan of a map agrees with it nearly as well as scans did with the map before.
  [[nodiscard]] bool begins_in_family(const Alignment& alignment, const MotionEstimator& motion) const;
  /// Whether it agrees nearly as well as scans usually do, but for chance.
  [[nodiscard]] bool is_in_family(const Alignment& alignment, const MotionEstimator& motion) const;
  /// Whether other hypotheses are worth a comparison: it agrees less, or has no pose of a vehicle.
  [[nodiscard]] bool is_doubtful(const Alignment& alignment, const MotionEstimator& motion) const;
  [[nodiscard]] bool accepts(const Alignment& alignment, const MotionEstimator& motion) const;

  // Decisions; each before the motion is updated with it.
  TrackingState accept(const Alignment& alignment, const MotionEstimator& motion);
  /// The registration failed; `for_lack_of_time` is no reason to recover.
  TrackingState fail(const Alignment& alignment, const MotionEstimator& motion, bool for_lack_of_time);
  /// State of a predicted pose without registration, after so many more scans.
  [[nodiscard]] TrackingState state_without_registration(const MotionEstimator& motion,
                                                         const MotionFilter& predicted,
                                                         int scans_to_come) const;
  /// A relocalisation tried all hypotheses.
  void count_search() { ++searches_; }

  // Poses that leave the odometry. Tracking vouches for the motion of a second.
  /// State to publish for a pose whose registration has `state`: lost if no vehicle can have driven to it
  /// and to those of the last second, not tracking if it or one of those is uncertain.
  [[nodiscard]] TrackingState published_state(const PublishedPose& pose, TrackingState state) const;
  void publish(const PublishedPose& pose, TrackingState state);

 private:
  [[nodiscard]] bool is_usual(const Alignment& alignment, const MotionEstimator& motion, double usual) const;
  [[nodiscard]] double seen_before(const Alignment& alignment) const;
  [[nodiscard]] bool leads_elsewhere(const Alignment& alignment, const MotionEstimator& motion) const;
  [[nodiscard]] bool bridges_gap(const Alignment& alignment, const MotionEstimator& motion) const;
  [[nodiscard]] bool exceeds_motion_limits(const Alignment& alignment, const MotionEstimator& motion) const;
  [[nodiscard]] bool is_drivable_step(const PublishedPose& pose) const;

  CoarsePolicy coarse_policy_;
  bool has_coarse_;
  double plane_voxel_m_ = 0.0;
  double mean_agreement_ = 0.0;
  double former_agreement_ = 0.0;  ///< with the map before
  double mean_known_share_ = 0.0;
  double prediction_error_m_ = 0.0;
  int coarse_scans_left_;
  /// Whether the last pose was relocalised or out of family, how many were so in a row (predicted ones
  /// included), predicted poses in a row, and complete relocalisations without success.
  bool doubtful_ = false;
  int doubts_ = 0;
  int failures_ = 0;
  int searches_ = 0;
  bool recovers_ = false;  ///< the last registration failed, and not for lack of time
  SE3 T_published_;
  double published_speed_m_s_ = 0.0;
  std::optional<Time> uncertain_at_;  ///< last uncertain pose
  std::optional<Time> jumped_at_;     ///< last pose to which no vehicle can have driven
  std::optional<Time> elsewhere_at_;  ///< last pose behind a gap in a place that the map does not know
};

/// How far the mean agreement of the points may be off for their number (three deviations): values between 0
/// and 1 with the mean a have a variance of a (1 - a) at most.
[[nodiscard]] double chance_of_agreement(const Alignment& alignment);

/// Whether the alignment has a pose at which a vehicle can be: its speed is one of a vehicle, and a
/// relocalised pose is a local optimum.
[[nodiscard]] bool is_plausible(const Alignment& alignment, const MotionEstimator& motion);
/// Whether a deviation from constant motion is within the acceleration limits.
[[nodiscard]] bool is_drivable_deviation(const SE3& deviation, double seconds);

}  // namespace nilio::core
