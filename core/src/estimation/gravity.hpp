#pragma once

namespace nilio::core {

/// What an accelerometer at rest shows, m/s^2.
inline constexpr double kGravity = 9.81;

}  // namespace nilio::core
