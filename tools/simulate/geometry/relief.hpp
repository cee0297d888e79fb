#pragma once

#include "tools/simulate/geometry/route.hpp"

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace nilio::tools::simulate {

/// Terrain relief: five waves of random direction and length, each with the given steepness (amplitude over
/// length).
struct Relief {
  struct Wave {
    Vector2 number;  ///< rad/m
    double phase = 0.0;
    double amplitude = 0.0;
  };
  std::array<Wave, 5> waves;

  Relief(RandomStream random, double shortest_m, double longest_m, double steepness) {
    for (Wave& wave : waves) {
      const double length = random.uniform(shortest_m, longest_m);
      const double direction = random.uniform(0.0, 2.0 * std::numbers::pi);
      wave.number = 2.0 * std::numbers::pi / length * Vector2(std::cos(direction), std::sin(direction));
      wave.phase = random.uniform(0.0, 2.0 * std::numbers::pi);
      wave.amplitude = steepness * length;
    }
  }

  [[nodiscard]] GroundSlope at(const Vector2& p) const {
    GroundSlope slope;
    for (const Wave& wave : waves) {
      const double phase = wave.number.dot(p) + wave.phase;
      slope.height += wave.amplitude * std::sin(phase);
      slope.gradient += wave.amplitude * std::cos(phase) * wave.number;
    }
    return slope;
  }
};

}  // namespace nilio::tools::simulate
