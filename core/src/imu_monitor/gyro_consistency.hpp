#pragma once

#include "nilio/core/se3.hpp"

namespace nilio::core {

/// Consistency test of the gyro: does it predict the registered rotation better than a constant rate? It is
/// accepted on evidence from turns (any gyro agrees with a straight road), rejected when clearly worse, and
/// accepted again after more evidence.
class GyroConsistency {
 public:
  /// Adds the mean rates over a scan of `seconds`, rad/s.
  void add(const Vector3& gyro, const Vector3& registered, double seconds);
  [[nodiscard]] bool is_inconsistent(const Vector3& gyro, const Vector3& registered, double seconds) const;
  void reject();
  /// Discards the statistics but keeps the decision: the gyro's stamps were corrected.
  void reset_evidence();
  /// Marks a discontinuity: the next scan has no constant rate to be predicted from.
  void interrupt() { has_rate_ = false; }

  [[nodiscard]] bool accepted() const { return accepted_; }
  /// True after a rejection, or after turns that would have proven a sound gyro and that a constant rate
  /// predicted clearly better.
  [[nodiscard]] bool rejected() const;
  /// True once enough scans have been compared for the errors to be meaningful.
  [[nodiscard]] bool compared() const;
  /// Root mean squares of the last second, rad per scan.
  [[nodiscard]] double gyro_error() const;
  [[nodiscard]] double constant_rate_error() const;
  /// Error of a rotation by the gyro's scale and axes, relative to it, as turns have shown it.
  [[nodiscard]] double scale_deviation() const;
  [[nodiscard]] const Vector3& registered_rate() const { return rate_; }

 private:
  void update(double gyro_angle, double constant_angle, double turned);
  void gather_evidence(double gyro_angle, double constant_angle, double turned);
  [[nodiscard]] bool is_proven() const;

  Vector3 rate_ = Vector3::Zero();
  bool has_rate_ = false;
  double gyro_squares_ = 0.0;
  double constant_squares_ = 0.0;
  double turned_squares_ = 0.0;
  double weight_ = 0.0;
  bool accepted_ = false;
  bool rejected_ = false;
  /// Sums of squared errors over scans that turned since the start or the last withdrawal, rad^2.
  double gyro_evidence_ = 0.0;
  double constant_evidence_ = 0.0;
  double turned_evidence_ = 0.0;  ///< sum of squared rotations
};

}  // namespace nilio::core
