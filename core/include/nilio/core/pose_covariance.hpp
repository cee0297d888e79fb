#pragma once

#include "nilio/core/odometry.hpp"
#include "nilio/core/registration.hpp"

namespace nilio::core {

/// How uncertain the pose has become along axes of base_link that the scans do not show, while they do not:
/// every scan the predicted displacement may be off by what predictions were off by when there was something
/// to see, and stays so, as a speed does.
class UnobservedDrift {
 public:
  /// After each scan; an axis that is not weak is known again. Bits and axes as in
  /// RegistrationResult::degenerate_axes.
  void advance(std::uint8_t weak_axes, const Vector6& prediction_square);
  /// m^2, rad^2.
  [[nodiscard]] const Vector6& variance() const { return position_; }

 private:
  Vector6 position_ = Vector6::Zero();
  Vector6 cross_ = Vector6::Zero();
  Vector6 velocity_ = Vector6::Zero();
};

/// What the covariance of a pose follows from.
struct PoseEvidence {
  const RegistrationResult& registration;
  /// Mean square of what registration corrected the last predictions by, in axes of base_link; m^2, rad^2.
  const Vector6& prediction_square;
  /// Of axes that the scans have not shown lately.
  Vector6 drift = Vector6::Zero();
  double span_s = 0.0;       ///< since the previous pose
  double predicted_s = 0.0;  ///< since the last pose that was registered
};

/// Fills pose and twist covariance of a result whose pose is set: the inverse of the information matrix times
/// the residual variance; what deskewing with a motion that has changed since does to a scan; floors for what
/// neither shows (calibration, map noise). Along axes that are not observed the variance grows with every such
/// pose, for poses that are only predicted with the time since the last registered one.
void fill_covariance(const PoseEvidence& evidence, OdometryResult& result);

}  // namespace nilio::core
