#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace nilio::tools::simulation {

/// Light that comes back from one surface to one shot.
struct Echo {
  double range_m = 0.0;
  /// Share of the light that comes back, 0 to 1; more from a retroreflector.
  double reflectance = 0.0;
  /// How far beyond the noise it is: 1 = just seen.
  double margin = 1.0;

  /// What the receiver sees: falls with the square of the range.
  [[nodiscard]] double strength() const { return reflectance / (range_m * range_m); }
};

/// The two echoes of a shot that a sensor in dual return mode sends, as indices; the same one twice when
/// there is only one.
struct ReturnPair {
  std::size_t last = 0;
  /// The strongest, or the second strongest when the strongest is the last.
  std::size_t strongest = 0;
};
/// Nothing without echoes.
std::optional<ReturnPair> choose_returns(std::span<const Echo> echoes);

/// A VLS-128's words of confidence in two returns, 12 bits each with the last return's lowest: bits 8 to 10
/// are a confidence of 0 to 7 that grows with the margin. The other bits tell interference, sun light and
/// ghosts of retroreflectors, which are not simulated; their order is an open driver's, and how two words
/// share three bytes is ours.
std::uint32_t confidence_bits(const Echo& last, const Echo& strongest);

}  // namespace nilio::tools::simulation
