#include "nilio/core/tracking.hpp"

namespace nilio::core {

const char* name_of(TrackingState state) {
  switch (state) {
    case TrackingState::kInitialising:
      return "initialising";
    case TrackingState::kTracking:
      return "tracking";
    case TrackingState::kDegraded:
      return "degraded";
    case TrackingState::kLost:
      return "lost";
  }
  return "unknown";
}

const char* name_of(StopReason reason) {
  switch (reason) {
    case StopReason::kConverged:
      return "converged";
    case StopReason::kMaxIterations:
      return "max_iterations";
    case StopReason::kBudget:
      return "budget";
    case StopReason::kTooFewPoints:
      return "too_few_points";
    case StopReason::kDegenerate:
      return "degenerate";
    case StopReason::kNonFinite:
      return "non_finite";
  }
  return "unknown";
}

const char* name_of(ClockSource source) {
  switch (source) {
    case ClockSource::kHost:
      return "host";
    case ClockSource::kFreeRunning:
      return "free_running";
    case ClockSource::kNmeaOnly:
      return "nmea_only";
    case ClockSource::kPpsLocked:
      return "pps_locked";
    case ClockSource::kPtp:
      return "ptp";
    case ClockSource::kHostAgreement:
      return "host_agreement";
  }
  return "?";
}

}  // namespace nilio::core
