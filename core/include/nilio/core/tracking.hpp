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

/// What the time of a scan rests on.
enum class ClockSource : std::uint8_t {
  kHost,         ///< receive times: the sensor has no clock, or the configuration says so
  kFreeRunning,  ///< the sensor's own oscillator, fitted onto the host's clock
  kNmeaOnly,     ///< the sensor knows the time of a GPS receiver but not its pulse
  kPpsLocked,    ///< locked to the pulse of a GPS receiver
  kPtp,          ///< no pulse, yet in step with the host's clock, as PTP makes it
};

/// "initialising", "converged", ... as logs and tables print them.
const char* name_of(TrackingState state);
const char* name_of(StopReason reason);
/// "pps_locked", ...
const char* name_of(ClockSource source);

}  // namespace nilio::core
