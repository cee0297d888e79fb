#pragma once

#include <cstdint>

namespace nilio::core {

/// What the odometry says of itself after a scan.
enum class TrackingState : std::uint8_t {
  kInitialising,  ///< map and velocity are not yet established
  kTracking,
  kDegraded,  ///< this pose rests on the prediction in part or in whole
  kLost,      ///< several scans in a row could not be registered
};

/// Why a registration stopped.
enum class StopReason : std::uint8_t {
  kConverged,
  kMaxIterations,
  kBudget,
  kTooFewPoints,
  kDegenerate,
  kNonFinite
};

/// "initialising", "converged", ... as logs and tables print them.
const char* name_of(TrackingState state);
const char* name_of(StopReason reason);

}  // namespace nilio::core
