#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <optional>
#include <string>

namespace nilio::tools::simulate {

/// Particles in the air and water on the ground.
struct Weather {
  /// One-way attenuation of light, 1/m.
  double attenuation = 0.0;
  /// Mean number of drops or grains per metre of beam that give an echo when nearer than `echo_range_m`.
  double echoes_per_m = 0.0;
  double echo_range_m = 0.0;
  /// Share of the dry diffuse reflectivity of horizontal surfaces.
  double ground_reflectivity = 1.0;

  /// Range of the first echo from the air, or unset; `word`: random.
  [[nodiscard]] std::optional<double> air_echo(std::uint64_t word) const;
};

/// "rain=10" (mm/h), "fog=100" (m of visibility), "dust=50" (m of visibility), "wet"; empty = clear.
core::Result<Weather> parse_weather(const std::string& text);

}  // namespace nilio::tools::simulate
