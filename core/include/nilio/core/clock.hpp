#pragma once

#include <cstdint>
#include <time.h>

namespace nilio {

/// Time of a kernel clock, ns. For what stands around the algorithms: core itself reads no clock.
inline std::int64_t clock_ns(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

/// CLOCK_MONOTONIC, ns: the clock of every latency stamp.
inline std::int64_t monotonic_ns() { return clock_ns(CLOCK_MONOTONIC); }
/// The same in seconds.
inline double monotonic_s() { return 1e-9 * static_cast<double>(monotonic_ns()); }

}  // namespace nilio
