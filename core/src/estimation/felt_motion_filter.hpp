#pragma once

#include "nilio/core/se3.hpp"

namespace nilio::core {

/// How far a motion may be off that is carried on by what the accelerometer feels: the error-state Kalman
/// filter of place, velocity and support (AccelerometerJudge), all in odom axes and with what each knows of
/// the others. A place is known against the local map, which scans before have made, not against the start.
/// The states themselves are elsewhere: pose, TwistFilter, AccelerometerJudge. Not thread-safe.
class FeltMotionFilter {
 public:
  /// Along each axis.
  struct Variances {
    double velocity = 0.0;  ///< m^2/s^2
    double support = 0.0;   ///< m^2/s^4
  };
  /// At a place that was just registered.
  void begin(const Variances& variances);
  /// So much time is predicted, s, in which the vehicle's heading turns by so much, rad.
  void advance(double seconds, double turn_rad);
  /// Nothing of before says anything of what follows: it has to begin anew.
  void forget() { has_begun_ = false; }
  [[nodiscard]] bool has_begun() const { return has_begun_; }
  /// Of the place along base_link's axes, m^2.
  [[nodiscard]] Vector3 place_variance(const Matrix3& R_odom_base) const;
  /// By how much a velocity has to be corrected for each metre that its place was, along base_link's axes,
  /// 1/s.
  [[nodiscard]] Vector3 velocity_gain(const Matrix3& R_odom_base) const;
  /// A registration moved the predicted place by `moved`, m, of which the scan, not the prediction, decided
  /// `share`, 0 to 1; both along base_link's axes. Returns what to add to the support, in odom axes.
  Vector3 correct(const Matrix3& R_odom_base, const Vector3& moved, const Vector3& share);
  /// Whether scans lately moved places farther than the filter can explain: what it takes to be known, the
  /// support above all, is wrong.
  [[nodiscard]] bool is_contradicted() const;
  /// Mean of its axes.
  [[nodiscard]] double support_variance() const { return covariance_.block<3, 3>(6, 6).trace() / 3.0; }

 private:
  using Vector9 = Eigen::Matrix<double, 9, 1>;
  using Matrix9 = Eigen::Matrix<double, 9, 9>;

  void bound_place(const Vector3& direction);

  bool has_begun_ = false;
  Matrix9 covariance_ = Matrix9::Zero();  ///< place, velocity, support
  /// Squares of innovations over their variances, and how many the scans' shares make of them, fading.
  double normalised_squares_ = 0.0;
  double innovations_ = 0.0;
};

}  // namespace nilio::core
