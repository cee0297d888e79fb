#pragma once

#include <cstdint>
#include <numbers>

namespace nilio {

inline constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;
inline constexpr double kDegreesPerRadian = 180.0 / std::numbers::pi;

inline constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;

}  // namespace nilio
