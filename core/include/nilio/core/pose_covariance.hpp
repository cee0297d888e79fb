#pragma once

#include "nilio/core/odometry.hpp"
#include "nilio/core/registration.hpp"

namespace nilio::core {

/// Fills pose and twist covariance of a result whose pose is set: the inverse of the information matrix times
/// the residual variance, with floors for what the residuals do not show (calibration, map noise), and a
/// large variance along axes that were not observed or when the pose is only predicted. `span_s` is the time
/// since the previous pose.
void fill_covariance(const RegistrationResult& registration, double span_s, OdometryResult& result);

}  // namespace nilio::core
