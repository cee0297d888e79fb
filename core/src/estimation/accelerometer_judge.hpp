#pragma once

#include "nilio/core/se3.hpp"

namespace nilio::core {

/// Whether an accelerometer predicts a vehicle's velocity better than holding it does, and what has to be
/// subtracted for that: gravity's counterforce together with what biases and tilts of odom add to it, in odom
/// axes. The first is a sequential test of one against the other (Wald 1945), the second a Kalman filter, so
/// that velocities are believed as far as they are found to be exact. An accelerometer with wrong axes, unit
/// or range is left out, and taken up again when it is mended. Not thread-safe.
class AccelerometerJudge {
 public:
  /// What a span of `seconds` between two scans showed, all in odom axes, m/s.
  struct Evidence {
    Vector3 felt;             ///< integral of the specific force
    Vector3 measured;         ///< change of the velocity of the place where it was felt
    double held_error = 0.0;  ///< of holding the velocity in the vehicle's axes
    double seconds = 0.0;
    /// Takes from a change what the scans have shown of it, where they did not show every direction.
    Matrix3 seen = Matrix3::Identity();
    /// The support is corrected elsewhere, together with place and velocity.
    bool only_weigh = false;
  };
  void learn(const Evidence& evidence);
  /// As it is found elsewhere, with its variance along each axis, m^2/s^4.
  void know_support(const Vector3& support, double variance);

  [[nodiscard]] bool helps() const;
  /// Specific force at constant velocity, m/s^2.
  [[nodiscard]] const Vector3& support() const { return support_; }
  [[nodiscard]] double support_variance() const { return support_variance_; }
  /// Of a measured velocity along each axis, m^2/s^2.
  [[nodiscard]] double velocity_variance() const { return noise_square_; }

 private:
  void learn_noise(double square);

  int spans_ = 0;
  Vector3 support_ = Vector3::Zero();
  double support_variance_ = 0.0;  ///< along each axis
  double noise_square_ = 0.0;      ///< of a measured change of velocity, along each axis
  double log_likelihood_ratio_ = 0.0;
};

}  // namespace nilio::core
