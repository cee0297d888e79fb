#pragma once

#include "nilio/core/se3.hpp"

namespace nilio::core {

/// Consistency test of the accelerometer: does it predict the vehicle's velocity better than a constant
/// velocity? A sequential probability ratio test (Wald 1945) decides; a Kalman filter estimates the vector to
/// subtract from the specific force, which is gravity, bias and the tilt of odom together, in odom axes. An
/// accelerometer with wrong axes, unit or range is not used until it recovers. Not thread-safe.
class AccelerometerConsistency {
 public:
  /// Measurements over a span of `seconds` between two scans, in odom axes, m/s.
  struct Evidence {
    Vector3 imu_change;       ///< integral of the specific force
    Vector3 measured;         ///< change of the IMU's velocity
    double held_error = 0.0;  ///< error of a constant velocity in the vehicle's axes
    double seconds = 0.0;
    /// Projects a change onto the directions that the scans observed.
    Matrix3 seen = Matrix3::Identity();
    /// Runs the test only: gravity and bias are estimated elsewhere, with position and velocity.
    bool only_weigh = false;
  };
  void update(const Evidence& evidence);
  /// Sets the externally estimated vector and its variance along each axis, m^2/s^4.
  void set_gravity_bias(const Vector3& gravity_bias, double variance);

  [[nodiscard]] bool helps() const;
  /// Specific force at constant velocity, m/s^2.
  [[nodiscard]] const Vector3& gravity_bias() const { return gravity_bias_; }
  [[nodiscard]] double gravity_bias_variance() const { return gravity_bias_variance_; }
  /// Variance of a measured velocity along each axis, m^2/s^2.
  [[nodiscard]] double velocity_variance() const { return noise_square_; }

 private:
  void update_noise(double square);

  int spans_ = 0;
  Vector3 gravity_bias_ = Vector3::Zero();
  double gravity_bias_variance_ = 0.0;  ///< along each axis
  double noise_square_ = 0.0;           ///< of a measured change of velocity, along each axis
  double log_likelihood_ratio_ = 0.0;
};

}  // namespace nilio::core
