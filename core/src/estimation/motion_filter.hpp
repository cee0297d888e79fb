#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"
#include "nilio/core/units.hpp"

#include "core/src/estimation/imu_buffer.hpp"
#include "core/src/estimation/innovation_bias.hpp"

#include <optional>
#include <utility>

namespace nilio::core {

/// State of the vehicle at one time. The velocities are those of base_link in its own axes.
struct MotionState {
  Time time;
  SE3 T_map_base;
  Vector3 velocity = Vector3::Zero();            ///< m/s
  Vector3 angular_velocity = Vector3::Zero();    ///< rad/s
  Vector3 gyro_bias = Vector3::Zero();           ///< rad/s, in base_link axes
  Vector3 accelerometer_bias = Vector3::Zero();  ///< m/s^2, in base_link axes
  Vector3 gravity = Vector3::Zero();             ///< m/s^2, in map axes, pointing down
  /// Rotation vector of the map's tilt below the vehicle since take_tilt(), rad, in map axes.
  Vector3 tilt = Vector3::Zero();
  /// Manoeuvres where no sensor measures them: change of the velocity ahead and to the left, m/s^2, and of
  /// the yaw rate, rad/s^2.
  Vector3 acceleration = Vector3::Zero();
  Vector3 angular_acceleration = Vector3::Zero();

  [[nodiscard]] Vector6 twist() const {
    Vector6 result;
    result << velocity, angular_velocity;
    return result;
  }
};

/// Sensors that drive the prediction over a span.
struct MotionInputs {
  const ImuBuffer* imu = nullptr;          ///< needed for the two below
  Vector3 imu_position = Vector3::Zero();  ///< in base_link, m
  bool gyro = false;  ///< the gyro gives the rates; otherwise they stay, roll's and pitch's decay
  double gyro_scale_deviation = 0.0;  ///< error by its scale and axes, relative to the rate
  bool accelerometer = false;     ///< the accelerometer changes the velocity; otherwise it stays in body axes
  bool speed_is_observed = true;  ///< the last scan showed the position along base_link's x
  [[nodiscard]] bool measure_motion() const { return gyro && accelerometer; }
};

/// Motion of `state` to the time `to`, forwards or backwards.
[[nodiscard]] MotionState propagated(const MotionState& state, const MotionInputs& inputs, Time to);

/// Error-state Kalman filter of the vehicle's motion between the midpoints of sweeps; docs/algorithm.md has
/// the equations. Error: (translation, rotation) of T_map_base = T_estimate * Exp(error), then velocity,
/// angular velocity, gyro bias, accelerometer bias, gravity, tilt and manoeuvres as differences. The pose is
/// relative to the map, whose drift is not part of it; a gyro tells its tilt from a turn. Not thread-safe.
class MotionFilter {
 public:
  static constexpr int kSize = 27;
  /// Deviation of gravity along each axis at a start in motion, m/s^2: acceleration and tilt are unknown.
  static constexpr double kGravityPrior = 1.5;
  /// Rates of roll and pitch until scans have shown those of the vehicle, rad/s: driving off road.
  static constexpr double kSwayRate = 5.0 * kRadiansPerDegree;
  using Vector = Eigen::Matrix<double, kSize, 1>;
  using Matrix = Eigen::Matrix<double, kSize, kSize>;
  enum Block : int {
    kPose = 0,
    kRotation = 3,
    kVelocity = 6,
    kRate = 9,
    kGyroBias = 12,
    kAccelBias = 15,
    kGravityBlock = 18,
    kTilt = 21,
    kManoeuvre = 24  ///< ahead, to the left, yaw
  };

  MotionFilter() = default;
  MotionFilter(const MotionState& state, const Matrix& covariance) : state_(state), covariance_(covariance) {}

  /// Starts at rest or in motion: the velocity is unknown, gravity only roughly.
  void reset(const SE3& T_map_base, Time time);
  /// The pose becomes that of a new map, exactly known; all else stays.
  void begin_map();
  /// Sets the pose after a recovery; the velocities become unknown.
  void relocate(const SE3& T_map_base);
  /// Sets the pose, as exactly known.
  void set_pose(const SE3& T_map_base) { state_.T_map_base = T_map_base; }
  /// The clock was set ahead.
  void move_clock(Duration by);
  /// The tilt so far, which is zero from then on; nothing else changes.
  Vector3 take_tilt() { return std::exchange(state_.tilt, Vector3::Zero()); }
  /// Sets the velocities, as found by a search.
  void set_twist(const Vector6& twist, const Vector6& variance);
  /// Sets gravity and bias together by a mean specific force in map axes, m/s^2, with its variance along each
  /// axis.
  void set_gravity(const Vector3& specific_force, double variance);

  /// Predicts to the time `to`: the last ten seconds before it, as where the clock jumped, and nothing where
  /// it jumped back.
  void propagate(const MotionInputs& inputs, Time to);
  /// Scales the variance of manoeuvres on the axes where the registered pose contradicts the prediction, for
  /// the next propagation until an update. Returns whether there was any.
  bool adapt_to_manoeuvre(const SE3& T_map_base, const MotionInputs& inputs);
  /// Takes the scales of another filter.
  void adapt_as(const MotionFilter& other) { manoeuvre_scale_ = other.manoeuvre_scale_; }
  /// The state given the pose (most probable): what is correlated with the pose follows it.
  [[nodiscard]] MotionState conditioned_on(const SE3& T_map_base) const;
  /// The state given pose and twist.
  [[nodiscard]] MotionState conditioned_on(const SE3& T_map_base, const Vector6& twist) const;
  /// Updates with the pose that registration found together with pose_covariance() as prior, and the
  /// information of the scan alone, in axes of base_link.
  void update(const SE3& T_map_base, const Matrix6& information);
  /// The same with the twist, and the joint information of pose and twist; not for rates from a gyro.
  void update(const SE3& T_map_base, const Vector6& twist, const Matrix12& information);
  /// Squared Mahalanobis distance of a pose from the prediction, 6 degrees of freedom: of the scan alone with
  /// `information`, at the pose that it and the prediction give together.
  [[nodiscard]] double normalised_innovation_squared(const SE3& T_map_base, const Matrix6& information) const;
  /// The innovation of that pose with its weight.
  [[nodiscard]] WeightedInnovation weighted_innovation(const SE3& T_map_base,
                                                       const Matrix6& information) const;
  /// Squared Mahalanobis distance of a relocalised pose from the prediction, 6 degrees of freedom.
  [[nodiscard]] double squared_distance(const SE3& T_map_base) const;
  /// Updates with velocities of zero, and sets the pose: that of all sweeps of a stationary vehicle.
  void zero_motion_update(const SE3& T_map_base);
  /// Updates with a velocity, and a rate, of zero: those of a stationary vehicle.
  void zero_velocity_update();
  /// Whether the velocity differs from zero by no more than its covariance allows (99.9 %).
  [[nodiscard]] bool may_be_stationary() const;

  [[nodiscard]] const MotionState& state() const { return state_; }
  [[nodiscard]] const Matrix& covariance() const { return covariance_; }
  [[nodiscard]] Matrix12 motion_covariance() const { return covariance_.topLeftCorner<12, 12>(); }
  [[nodiscard]] Matrix6 pose_covariance() const { return covariance_.topLeftCorner<6, 6>(); }
  /// That of the pose in axes without the map's tilt, in axes of base_link.
  [[nodiscard]] Matrix6 levelled_pose_covariance() const;
  [[nodiscard]] Matrix6 twist_covariance() const { return covariance_.block<6, 6>(kVelocity, kVelocity); }

 private:
  void step(const MotionInputs& inputs, Time to);
  void apply(const Vector& error);
  /// S^-1 = (P + H^-1)^-1 = (I + H P)^-1 H of a scan with information H: needs neither inverse.
  [[nodiscard]] Matrix6 innovation_information(const Matrix6& information) const;
  [[nodiscard]] MotionState conditioned_by(const Vector& error, const SE3& T_map_base) const;
  /// Gives a block this covariance of its own, and no correlation with the others.
  void isolate(int block, const Matrix3& covariance);
  void forget_manoeuvres();
  void forget_manoeuvre(int i, const MotionInputs& inputs);
  void symmetrise();
  void estimate_sway();
  void end_update();

  MotionState state_;
  Matrix covariance_ = Matrix::Zero();
  std::optional<Time> last_update_;            ///< none after a jump
  Vector6 manoeuvre_scale_ = Vector6::Ones();  ///< of the variance of manoeuvres until the next update
  /// Mean square of the rates of roll and pitch, rad^2/s^2: a property of vehicle and road.
  Eigen::Vector2d sway_square_ = Eigen::Vector2d::Constant(kSwayRate * kSwayRate);
  bool had_gyro_ = false;
};

}  // namespace nilio::core
