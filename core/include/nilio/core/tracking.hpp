#pragma once

#include <cstdint>

namespace nilio::core {

/// State of the odometry after a scan.
enum class TrackingState : std::uint8_t {
  kInitialising,  ///< map and velocity are not yet established
  kTracking,
  kDegraded,  ///< the pose follows the prediction in part or as a whole, or is not known well enough
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

/// Source of the time of a scan.
enum class ClockSource : std::uint8_t {
  kHost,           ///< receive times: the sensor has no clock, or the configuration says so
  kFreeRunning,    ///< the sensor's own oscillator, fitted onto the host's clock
  kNmeaOnly,       ///< the sensor receives GPS time but no pulse
  kPpsLocked,      ///< locked to the pulse of a GPS receiver
  kPtp,            ///< no pulse, but synchronous with the host's clock, and the model has PTP
  kHostAgreement,  ///< agrees with the host's clock for an unknown reason
};

/// "initialising", "converged", ... as logs and tables print them.
const char* name_of(TrackingState state);
const char* name_of(StopReason reason);
/// "pps_locked", ...
const char* name_of(ClockSource source);

}  // namespace nilio::core
