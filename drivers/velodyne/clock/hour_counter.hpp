#pragma once

#include <cstdint>

namespace nilio::drivers {

/// The sensors' counter: microseconds past the hour.
inline constexpr std::int64_t kHourUs = 3'600'000'000;
/// A packet may arrive so much later than packets that were sent after it.
inline constexpr std::int64_t kReorderWindowNs = 50'000'000;

/// Difference of two counters modulo one hour, in (-30 min, 30 min].
constexpr std::int64_t hour_difference_ns(std::uint32_t now_us, std::uint32_t before_us) {
  std::int64_t difference =
      (static_cast<std::int64_t>(now_us) - static_cast<std::int64_t>(before_us)) % kHourUs;
  if (difference > kHourUs / 2) difference -= kHourUs;
  if (difference <= -kHourUs / 2) difference += kHourUs;
  return difference * 1000;
}

}  // namespace nilio::drivers
