#pragma once

#include "nilio/core/odometry_config.hpp"
#include "nilio/core/scan.hpp"

#include "core/src/estimation/imu_buffer.hpp"
#include "core/src/estimation/innovation_bias.hpp"
#include "core/src/estimation/motion_filter.hpp"
#include "core/src/estimation/stationary_detector.hpp"
#include "core/src/imu_monitor/imu_monitor.hpp"
#include "core/src/preprocessing/deskewing.hpp"
#include "core/src/registration/registration.hpp"

#include <cstdint>

namespace nilio::core {

/// Scans until map and velocity are established. Insertion is denser meanwhile, because one downsampled scan
/// leaves too few points per voxel.
inline constexpr std::uint64_t kInitialScans = 5;
/// Limits of the deviation of a predicted point at the lever, metres: the upper one where nothing is known,
/// the lower one for a relocalised pose.
inline constexpr double kMaxSigmaMetres = 2.0;
inline constexpr double kMinSigmaMetres = 0.1;
/// Standard deviation of a point at the lever for the covariance of a pose, within these limits.
[[nodiscard]] double deviation_at_lever(const Matrix6& pose_covariance);
/// The filter of a scan's prediction with what its registration shows.
[[nodiscard]] MotionFilter updated(MotionFilter predicted, const RegistrationResult& registration);
/// Squared Mahalanobis distance, 99.9 % of 6 degrees of freedom.
inline constexpr double kFarInnovation = 22.46;
/// Maximum lag of the last IMU sample behind the end of a live scan; the rate is held constant.
inline constexpr Duration kMaxImuLag = Duration::from_milliseconds(15.0);

/// Basis of the prediction of a scan's motion.
struct MotionPrior {
  Time previous;  ///< of the last pose
  SweepSpan span;
  bool imu_covers = false;  ///< from the midpoint of the last sweep to the end of this one
  MotionInputs inputs;
  bool is_stationary = false;
  bool is_gap = false;        ///< longer than scans are apart
  bool is_known_gap = false;  ///< and no clock was set meanwhile, or it is known how far
  bool motion_compensated = false;
  [[nodiscard]] double span_s() const { return (span.end - previous).seconds(); }
};

/// Motion of the vehicle from scan to scan (NI-LIO 3.4): which sensors drive the prediction, the filter of
/// its state at the midpoints of sweeps, and the motion over a sweep, by which points are deskewed. Owns the
/// IMU's samples and their monitor. Not thread-safe.
class MotionEstimator {
 public:
  /// A motion of the scan, to return to after another one was tried.
  struct Hypothesis {
    MotionPrior prior;
    MotionFilter last_filter;
    MotionFilter filter;
    SweepMotion motion;
    bool gravity_known = false;
  };

  explicit MotionEstimator(const OdometryConfig& config);

  /// Odometry::add_imu().
  bool add_imu(const ImuSample& sample);
  [[nodiscard]] const ImuBuffer& imu() const { return imu_; }
  [[nodiscard]] const ImuMonitor& monitor() const { return monitor_; }

  // The beginning of a map.
  /// Levels the output by gravity, as far as the IMU shows it during the first scan.
  void level(const Scan& scan);
  /// The map ends; the motion goes on where the IMU measured it, and behind a gap.
  void leave_map();
  /// First scan of a map. Returns the covariance of its pose against the map before, in axes of base_link;
  /// zero without one.
  Matrix6 start(const Scan& scan);
  /// Places the first sweep again, with the velocity that is known by now.
  void place_first_sweep(const SweepSpan& span);

  // Predictions of a scan; each replaces that before.
  void predict(const Scan& scan);
  /// Without the IMU.
  void predict_without_imu();
  /// As a moving vehicle, against the IMU's opinion that it is stationary.
  void predict_moving();
  /// Whether the next prediction is that of a stationary vehicle, whatever the IMU says.
  void assume_stationary(bool is_stationary) { prior_.is_stationary = is_stationary; }
  /// Sets the twist at the last scan, and its variance; then predict_again().
  void set_last_twist(const Vector6& twist, const Vector6& variance);
  void predict_again();
  /// After another motion than that of the last scan, for which the filter is `earlier`; without the
  /// accelerometer.
  void predict_after(const MotionFilter& earlier, bool gravity_known);
  /// The IMU was wrong about a stationary vehicle, and with it the gravity that it gave.
  void end_stationary();

  // During registration.
  /// The motion over the sweep follows the registered pose. Returns whether its end moves by less than
  /// registration resolves.
  bool follow(const RegistrationResult& registration);
  /// The motion over the sweep follows the prediction.
  void follow_prediction();
  /// Predicts again with the noise of a manoeuvre where the registered pose contradicts the prediction.
  /// Returns whether it does.
  bool widen_for_manoeuvre(const SE3& T_map_middle);
  void demote_imu() { monitor_.demote(); }

  // After registration: one of the three.
  void update(const RegistrationResult& registration);
  /// With the pose of a recovery, which is no motion of this scan.
  void relocate(const RegistrationResult& registration);
  /// Without a pose: along the prediction.
  void coast();
  /// Ends the scan, registered with these degenerate axes.
  void finish(std::uint8_t degenerate_axes);

  [[nodiscard]] Hypothesis hypothesis() const {
    return {prior_, last_filter_, filter_, motion_, gravity_known_};
  }
  void return_to(const Hypothesis& earlier);
  /// Only the motion over the sweep.
  void return_to(const SweepMotion& earlier) { motion_ = earlier; }

  /// Whether the registered pose is where the filter expects it.
  [[nodiscard]] bool fits(const RegistrationResult& registration) const;
  /// Whether the vehicle can have reached a pose that recovery found.
  [[nodiscard]] bool may_reach(const SE3& T_map_middle) const;
  /// Whether the registered motion contradicts the gyro clearly; only a rotation that the scan shows does.
  [[nodiscard]] bool contradicts_gyro(const RegistrationResult& registration) const;
  /// Deviation of a pose from the prediction.
  [[nodiscard]] SE3 prediction_error(const SE3& T_map_middle) const {
    return T_predicted_.inverse() * T_map_middle;
  }

  [[nodiscard]] MotionPrior prior_for(const Scan& scan) const;
  /// Whether the time since the last scan is longer than scans are apart.
  [[nodiscard]] bool is_behind_gap(const Scan& scan) const;
  [[nodiscard]] const MotionPrior& prior() const { return prior_; }
  [[nodiscard]] const MotionFilter& filter() const { return filter_; }
  [[nodiscard]] const SweepMotion& motion() const { return motion_; }
  /// Predicted pose at the midpoint of the sweep, and standard deviation of a point at the lever, metres.
  [[nodiscard]] const SE3& T_predicted() const { return T_predicted_; }
  [[nodiscard]] double deviation_m() const { return deviation_m_; }
  /// Pose at the end of the last sweep, the last one that is not a prediction, that at the midpoint of the
  /// last sweep, and that of all sweeps of a stationary vehicle.
  [[nodiscard]] const SE3& T_map_base() const { return T_map_base_; }
  [[nodiscard]] const SE3& T_accepted() const { return T_accepted_; }
  [[nodiscard]] const SE3& T_map_last_middle() const { return last_filter_.state().T_map_base; }
  [[nodiscard]] const SE3& T_stationary() const { return T_stationary_; }
  /// The map begins with the axes of its first pose and is levelled only in the output, so that registration
  /// does not depend on the accelerometer; where the map tilts, `odom` does not.
  [[nodiscard]] const SE3& T_odom_map() const { return T_odom_map_; }
  /// Time between the midpoints of the last sweep and this one.
  [[nodiscard]] double seconds_since_last_middle() const;
  /// Constant twist over that time to this pose of the midpoint of the sweep.
  [[nodiscard]] Vector6 twist_to(const SE3& T_map_middle) const;
  /// Time between scans, slowly averaged.
  [[nodiscard]] double period_s() const { return period_s_; }
  /// Scans of this map so far.
  [[nodiscard]] std::uint64_t scans() const { return scans_; }
  [[nodiscard]] bool is_initialising() const { return scans_ < kInitialScans; }
  /// Whether the motion at the beginning of the map goes on from before.
  [[nodiscard]] bool motion_goes_on() const { return motion_goes_on_; }
  void forget_motion() { motion_goes_on_ = false; }

 private:
  [[nodiscard]] RegisteredMotion motion_to(const RegistrationResult& registration) const;
  [[nodiscard]] bool detect_stationary();
  void initialise_gravity();
  void observe_innovation(const RegistrationResult& registration);
  void settle();
  void level_odom();

  SE3 T_base_imu_;
  Duration max_imu_gap_;
  ImuBuffer imu_;
  ImuMonitor monitor_;
  StationaryDetector stationary_detector_;
  MotionFilter filter_;
  MotionFilter last_filter_;  ///< before the prediction of the scan
  MotionPrior prior_;
  SweepMotion motion_;
  SE3 T_predicted_;
  double deviation_m_ = kMaxSigmaMetres;
  SE3 T_map_base_;
  SE3 T_accepted_;
  SE3 T_stationary_;
  SE3 T_odom_map_;
  double period_s_ = 0.1;
  std::uint64_t scans_ = 0;
  bool speed_is_observed_ = true;  ///< by the last scan
  bool motion_goes_on_ = false;
  bool gravity_known_ = false;
  InnovationBias innovation_bias_;  ///< of the scans that the IMU predicted
};

}  // namespace nilio::core
