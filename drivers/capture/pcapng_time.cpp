#include "drivers/capture/pcapng_time.hpp"

namespace nilio::drivers {
namespace {

constexpr std::int64_t kNsPerSecond = 1'000'000'000;
constexpr unsigned kNsExponent = 9;
/// Seconds that still are int64 nanoseconds.
constexpr std::int64_t kLargestSeconds = 9'000'000'000;
constexpr unsigned kLargestDecimal = 19;
constexpr unsigned kLargestBinary = 63;
/// Finer binary fractions are below a nanosecond, and would not fit the multiplication.
constexpr unsigned kFinestBinary = 30;

std::uint64_t power_of_ten(unsigned exponent) {
  std::uint64_t power = 1;
  for (unsigned i = 0; i < exponent; ++i) power *= 10;
  return power;
}

std::int64_t binary_fraction_ns(std::uint64_t fraction, unsigned exponent) {
  if (exponent > kFinestBinary) {
    fraction >>= exponent - kFinestBinary;
    exponent = kFinestBinary;
  }
  return static_cast<std::int64_t>((fraction * static_cast<std::uint64_t>(kNsPerSecond)) >> exponent);
}

std::int64_t decimal_fraction_ns(std::uint64_t fraction, unsigned exponent) {
  return static_cast<std::int64_t>(exponent <= kNsExponent ? fraction * power_of_ten(kNsExponent - exponent)
                                                           : fraction / power_of_ten(exponent - kNsExponent));
}

}  // namespace

std::optional<PcapngClock> with_resolution(PcapngClock clock, std::uint8_t option) {
  clock.binary = (option & 0x80) != 0;
  clock.exponent = option & 0x7FU;
  if (clock.exponent > (clock.binary ? kLargestBinary : kLargestDecimal)) return std::nullopt;
  return clock;
}

std::optional<std::int64_t> pcapng_time_ns(std::uint64_t ticks, const PcapngClock& clock) {
  const std::uint64_t rate = clock.binary ? std::uint64_t{1} << clock.exponent : power_of_ten(clock.exponent);
  const std::uint64_t whole = ticks / rate;
  const std::uint64_t fraction = ticks % rate;
  const bool fits = whole <= static_cast<std::uint64_t>(kLargestSeconds) &&
                    clock.offset_s >= -kLargestSeconds && clock.offset_s <= kLargestSeconds;
  if (!fits) return std::nullopt;
  const std::int64_t seconds = static_cast<std::int64_t>(whole) + clock.offset_s;
  if (seconds > kLargestSeconds) return std::nullopt;
  return seconds * kNsPerSecond + (clock.binary ? binary_fraction_ns(fraction, clock.exponent)
                                                : decimal_fraction_ns(fraction, clock.exponent));
}

}  // namespace nilio::drivers
