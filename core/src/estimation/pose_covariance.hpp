#pragma once

#include "nilio/core/odometry.hpp"

#include "core/src/registration/registration.hpp"

namespace nilio::core {

/// Variance along degenerate axes of base_link: each scan adds a prediction error that persists as a velocity
/// error.
class UnobservedDrift {
 public:
  /// Call after each scan; an observed axis is reset. Bits and axes as RegistrationResult::degenerate_axes.
  void advance(std::uint8_t weak_axes, const Vector6& prediction_error_variance);
  /// Variance, m^2 and rad^2.
  [[nodiscard]] const Vector6& variance() const { return position_; }

 private:
  Vector6 position_ = Vector6::Zero();
  Vector6 cross_ = Vector6::Zero();
  Vector6 velocity_ = Vector6::Zero();
};

/// Inputs of the pose covariance.
struct PoseEvidence {
  const RegistrationResult& registration;
  /// Mean square of recent corrections of predictions, in axes of base_link; m^2, rad^2.
  const Vector6& prediction_error_variance;
  /// Variance along degenerate axes.
  Vector6 drift = Vector6::Zero();
  double span_s = 0.0;       ///< since the previous pose
  double predicted_s = 0.0;  ///< since the last pose that was registered
};

/// Fills pose and twist covariance of a result with a pose: inverse information times residual variance, the
/// share of prediction errors left by deskewing, and floors for calibration and map noise. Variances grow
/// along degenerate axes with every pose, and for predicted poses with the time since the last registered
/// one.
void fill_covariance(const PoseEvidence& evidence, OdometryResult& result);

}  // namespace nilio::core
