#pragma once

#include <cstdint>
#include <optional>

namespace nilio::drivers {

/// How an interface of a pcapng file counts time.
struct PcapngClock {
  /// Ticks per second: 10^exponent, or 2^exponent.
  bool binary = false;
  unsigned exponent = 6;
  std::int64_t offset_s = 0;
};

/// The clock with the resolution option's byte (if_tsresol); nothing when ticks are finer than 64 bits can
/// count a second in.
std::optional<PcapngClock> with_resolution(PcapngClock clock, std::uint8_t option);

/// Nanoseconds since 1970, finer parts cut off; nothing beyond what int64 holds.
std::optional<std::int64_t> pcapng_time_ns(std::uint64_t ticks, const PcapngClock& clock);

}  // namespace nilio::drivers
