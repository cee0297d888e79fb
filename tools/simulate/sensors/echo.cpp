#include "tools/simulate/sensors/echo.hpp"

#include <algorithm>

namespace nilio::tools::simulation {

std::optional<ReturnPair> choose_returns(std::span<const Echo> echoes) {
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

std::uint32_t confidence_bits(const Echo& last, const Echo& strongest) {
  const auto word = [](const Echo& echo) {
    const double level = std::clamp(2.0 * (echo.margin - 1.0), 0.0, 7.0);
    return static_cast<std::uint32_t>(level) << 8U;
  };
  return word(last) | word(strongest) << 12U;
}

}  // namespace nilio::tools::simulation
