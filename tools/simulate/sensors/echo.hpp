#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace nilio::tools::simulate {

/// Light reflected by one surface to one shot.
struct Echo {
  double range_m = 0.0;
  /// Share of the reflected light, 0 to 1; more for a retroreflector.
  double reflectance = 0.0;
  /// Signal over the detection threshold; 1 = just detected.
  double margin = 1.0;

  /// Received intensity: decreases with the square of the range.
  [[nodiscard]] double strength() const { return reflectance / (range_m * range_m); }
};

/// Indices of the two echoes that a sensor reports in dual return mode; the same one twice if there is only
/// one.
struct ReturnPair {
  std::size_t last = 0;
  /// The strongest, or the second strongest when the strongest is the last.
  std::size_t strongest = 0;
};
/// Unset without echoes.
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

/// Confidence words of a VLS-128 for two returns, 12 bits each, the last return's in the low bits: bits 8 to
/// 10 are a confidence of 0 to 7 that grows with the margin. The other bits (interference, sun light, ghosts
/// of retroreflectors) are not simulated. The order of the bits is that of an open driver, the packing of two
/// words into three bytes our own.
inline std::uint32_t confidence_bits(const Echo& last, const Echo& strongest) {
  const auto word = [](const Echo& echo) {
    const double level = std::clamp(2.0 * (echo.margin - 1.0), 0.0, 7.0);
    return static_cast<std::uint32_t>(level) << 8U;
  };
  return word(last) | word(strongest) << 12U;
}

}  // namespace nilio::tools::simulate
