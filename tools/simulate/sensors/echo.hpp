#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace nilio::tools::simulate {

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
inline std::optional<ReturnPair> choose_returns(std::span<const Echo> echoes) {
  if (echoes.empty()) return std::nullopt;
  ReturnPair pair;
  for (std::size_t i = 1; i < echoes.size(); ++i) {
    if (echoes[i].range_m > echoes[pair.last].range_m) pair.last = i;
    if (echoes[i].strength() > echoes[pair.strongest].strength()) pair.strongest = i;
  }
  if (pair.strongest != pair.last || echoes.size() == 1) return pair;
  pair.strongest = pair.last == 0 ? 1 : 0;
  for (std::size_t i = 0; i < echoes.size(); ++i) {
    if (i != pair.last && echoes[i].strength() > echoes[pair.strongest].strength()) pair.strongest = i;
  }
  return pair;
}

/// A VLS-128's words of confidence in two returns, 12 bits each with the last return's lowest: bits 8 to 10
/// are a confidence of 0 to 7 that grows with the margin. The other bits tell interference, sun light and
/// ghosts of retroreflectors, which are not simulated; their order is an open driver's, and how two words
/// share three bytes is ours.
inline std::uint32_t confidence_bits(const Echo& last, const Echo& strongest) {
  const auto word = [](const Echo& echo) {
    const double level = std::clamp(2.0 * (echo.margin - 1.0), 0.0, 7.0);
    return static_cast<std::uint32_t>(level) << 8U;
  };
  return word(last) | word(strongest) << 12U;
}

}  // namespace nilio::tools::simulate
