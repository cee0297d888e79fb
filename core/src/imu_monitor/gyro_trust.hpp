#pragma once

#include "nilio/core/se3.hpp"

namespace nilio::core {

/// Whether the gyro predicts the registered rotation better than a constant rate does. Given once the gyro
/// has shown it while turning, for any gyro agrees with a straight road; withdrawn when the gyro is plainly
/// worse; given again after more evidence of the same kind.
class GyroTrust {
 public:
  /// Mean rates over a scan of `seconds`, rad/s.
  void add(const Vector3& gyro, const Vector3& registered, double seconds);
  [[nodiscard]] bool contradicted(const Vector3& gyro, const Vector3& registered, double seconds) const;
  void withdraw();
  /// What speaks against the gyro so far does not hold any more.
  void forget();
  /// The next scan does not follow the last: nothing to predict a constant rate from.
  void interrupt() { has_rate_ = false; }

  [[nodiscard]] bool given() const { return given_; }
  /// Agreement has been lost, or not come in bends that would have shown it.
  [[nodiscard]] bool refused() const;
  /// Enough scans have been compared to speak of an error.
  [[nodiscard]] bool compared() const;
  /// Root mean squares of the last second, rad per scan.
  [[nodiscard]] double gyro_error() const;
  [[nodiscard]] double constant_rate_error() const;
  [[nodiscard]] const Vector3& registered_rate() const { return rate_; }

 private:
  void update(double gyro_angle, double constant_angle, double turned);
  void gather_evidence(double gyro_angle, double constant_angle);
  [[nodiscard]] bool is_proven() const;

  Vector3 rate_ = Vector3::Zero();
  bool has_rate_ = false;
  double gyro_squares_ = 0.0;
  double constant_squares_ = 0.0;
  double weight_ = 0.0;
  bool given_ = false;
  bool withdrawn_ = false;
  /// Sums of squared errors over scans that turned since the start or the last withdrawal, rad^2.
  double gyro_evidence_ = 0.0;
  double constant_evidence_ = 0.0;
};

}  // namespace nilio::core
