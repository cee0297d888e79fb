#pragma once

#include <cstdint>
#include <ctime>

namespace nilio::dds {

/// CLOCK_MONOTONIC, as the stamps of records have it.
inline std::int64_t monotonic_ns() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

}  // namespace nilio::dds
