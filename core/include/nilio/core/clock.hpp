#pragma once

#include "nilio/core/time.hpp"
#include "nilio/core/units.hpp"

#include <algorithm>
#include <cstdint>
#include <time.h>

namespace nilio {

/// A kernel's time in nanoseconds.
inline std::int64_t ns_of(const timespec& time) {
  return std::int64_t{time.tv_sec} * kNanosecondsPerSecond + time.tv_nsec;
}
/// As ppoll() and timers take a span; negative = 0.
inline timespec to_timespec(core::Duration span) {
  const std::int64_t ns = std::max<std::int64_t>(span.ns, 0);
  return {.tv_sec = ns / kNanosecondsPerSecond, .tv_nsec = ns % kNanosecondsPerSecond};
}

/// Time of a kernel clock, ns. For what stands around the algorithms: core itself reads no clock.
inline std::int64_t clock_ns(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return ns_of(now);
}

/// CLOCK_MONOTONIC, ns: the clock of every latency stamp.
inline std::int64_t monotonic_ns() { return clock_ns(CLOCK_MONOTONIC); }
/// The same as a time, and in seconds.
inline core::Time monotonic_now() { return {monotonic_ns()}; }
inline double monotonic_s() { return 1e-9 * static_cast<double>(monotonic_ns()); }

}  // namespace nilio
