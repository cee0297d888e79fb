#pragma once

#include "nilio/core/se3.hpp"

namespace nilio::core {

/// Covariance of an IMU-predicted motion: error-state Kalman filter of position, velocity and
/// gravity-and-bias (AccelerometerConsistency) in odom axes. Position is relative to the local map, not to
/// the start. The means live elsewhere: pose, TwistFilter, AccelerometerConsistency. Not thread-safe.
class MotionFilter {
 public:
  /// Variances along each axis.
  struct Variances {
    double velocity = 0.0;      ///< m^2/s^2
    double gravity_bias = 0.0;  ///< m^2/s^4
  };
  /// Starts at a position that was just registered.
  void begin(const Variances& variances);
  /// Propagates by `seconds` while the heading turns by `turn_rad`.
  void advance(double seconds, double turn_rad);
  /// Discards the state; begin() starts it again.
  void forget() { has_begun_ = false; }
  [[nodiscard]] bool has_begun() const { return has_begun_; }
  /// Position variance along base_link's axes, m^2.
  [[nodiscard]] Vector3 position_variance(const Matrix3& R_odom_base) const;
  /// Kalman gain of velocity for a position innovation along base_link's axes, 1/s.
  [[nodiscard]] Vector3 velocity_gain(const Matrix3& R_odom_base) const;
  /// Updates with the registration's correction `moved` of the predicted position, m, and its observability
  /// `share`, 0 to 1, both along base_link's axes. Returns the correction of gravity-and-bias, in odom axes.
  Vector3 correct(const Matrix3& R_odom_base, const Vector3& moved, const Vector3& share);
  /// Whether recent innovations are larger than the filter explains (normalised innovation squared): its
  /// state, gravity-and-bias above all, is wrong.
  [[nodiscard]] bool is_contradicted() const;
  /// Mean over the axes, m^2/s^4.
  [[nodiscard]] double gravity_bias_variance() const { return covariance_.block<3, 3>(6, 6).trace() / 3.0; }

 private:
  using Vector9 = Eigen::Matrix<double, 9, 1>;
  using Matrix9 = Eigen::Matrix<double, 9, 9>;

  void bound_position(const Vector3& direction);

  bool has_begun_ = false;
  Matrix9 covariance_ = Matrix9::Zero();  ///< position, velocity, gravity-and-bias
  /// Normalised innovation squared and number of innovations, weighted by observability, with forgetting.
  double normalised_squares_ = 0.0;
  double innovations_ = 0.0;
};

}  // namespace nilio::core
