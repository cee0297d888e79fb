#pragma once

#include "nilio/core/imu_health.hpp"

namespace nilio::core {

/// Distances from normal_of() above which a check warns and is bad; 0 for one that is bad at once.
struct ImuCheckLimits {
  double warn = 0.0;
  double bad = 0.0;
};
ImuCheckLimits limits_of(ImuCheck check);

}  // namespace nilio::core
