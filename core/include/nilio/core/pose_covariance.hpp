#pragma once

#include "nilio/core/odometry.hpp"
#include "nilio/core/registration.hpp"

namespace nilio::core {

/// What the covariance of a pose follows from.
struct PoseEvidence {
  const RegistrationResult& registration;
  /// Mean square of what registration corrected the last predictions by, in axes of base_link; m^2, rad^2.
  const Vector6& prediction_square;
  double span_s = 0.0;  ///< since the previous pose
  int failures = 0;     ///< poses in a row, this one included, that are only predicted
};

/// Fills pose and twist covariance of a result whose pose is set: the inverse of the information matrix times
/// the residual variance; what deskewing with a motion that has changed since does to a scan; floors for what
/// neither shows (calibration, map noise). Along axes that were not observed and for poses that are only
/// predicted the variance is large, and grows with every such pose.
void fill_covariance(const PoseEvidence& evidence, OdometryResult& result);

}  // namespace nilio::core
