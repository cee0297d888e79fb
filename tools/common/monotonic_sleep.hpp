#pragma once

#include "nilio/core/time.hpp"

#include "daemon/input/receive.hpp"

#include <cstdint>
#include <ctime>

namespace nilio::tools {

/// Until an absolute time of CLOCK_MONOTONIC, so that neither the time since it was computed nor an
/// interruption adds up.
inline void sleep_until(std::int64_t monotonic_ns) {
  const timespec until{monotonic_ns / 1'000'000'000, monotonic_ns % 1'000'000'000};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
}

inline void sleep_for(core::Duration duration) { sleep_until(daemon::monotonic_ns() + duration.ns); }

}  // namespace nilio::tools
