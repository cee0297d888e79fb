#pragma once

#include "nilio/core/se3.hpp"

namespace nilio::core {

/// Whether the gyro predicts the registered rotation at least as well as a constant rate does. Given after a
/// second of agreement; withdrawn when the gyro is plainly worse; given again only after agreement while
/// turning, for any gyro agrees with a straight road.
class GyroTrust {
 public:
  /// Mean rates over a scan of `seconds`, rad/s.
  void add(const Vector3& gyro, const Vector3& registered, double seconds);
  [[nodiscard]] bool contradicted(const Vector3& gyro, const Vector3& registered, double seconds) const;
  void withdraw();
  /// The next scan does not follow the last: nothing to predict a constant rate from.
  void interrupt() { has_rate_ = false; }

  [[nodiscard]] bool given() const { return given_; }
  /// Agreement has been lost, or not come within three seconds.
  [[nodiscard]] bool refused() const;
  /// Enough scans have been compared to speak of an error.
  [[nodiscard]] bool compared() const;
  /// Root mean squares of the last second, rad per scan.
  [[nodiscard]] double gyro_error() const;
  [[nodiscard]] double constant_rate_error() const;
  [[nodiscard]] const Vector3& registered_rate() const { return rate_; }

 private:
  void update(double gyro_angle, double constant_angle, double turned);

  Vector3 rate_ = Vector3::Zero();
  bool has_rate_ = false;
  double gyro_squares_ = 0.0;
  double constant_squares_ = 0.0;
  double weight_ = 0.0;
  bool given_ = false;
  bool withdrawn_ = false;
  int consistent_turns_ = 0;
};

}  // namespace nilio::core
