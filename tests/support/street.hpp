#pragma once

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "mapping/keyframe.hpp"

namespace nilio::tests {

/// Keyframe number `i` of a drive along x, one metre each, in a street: the ground z = -2 and walls at y = 8
/// and y = -8, seen from base_link; points random within 30 m, exact.
inline mapping::Keyframe street_keyframe(int i, std::size_t points = 6000) {
  mapping::Keyframe keyframe;
  keyframe.stamp = {1'000'000'000'000LL + i * 100'000'000LL};
  keyframe.T_odom_base.translation = {1.0 * i, 0.3, 2.0};
  keyframe.covariance = 1e-4 * core::Matrix6::Identity();
  std::mt19937 random(static_cast<std::uint32_t>(i) + 1U);
  std::uniform_real_distribution<float> along(-30.0F, 30.0F);
  std::uniform_real_distribution<float> share(0.0F, 1.0F);
  for (std::size_t k = 0; k < points; ++k) {
    const float x = along(random);
    switch (k % 3) {
      case 0:
        keyframe.points.push_back({{x, -8.0F + 16.0F * share(random), -2.0F}, 20.0F});
        break;
      case 1:
        keyframe.points.push_back({{x, 8.0F, -2.0F + 5.0F * share(random)}, 120.0F});
        break;
      default:
        keyframe.points.push_back({{x, -8.0F, -2.0F + 5.0F * share(random)}, 60.0F});
    }
  }
  return keyframe;
}

}  // namespace nilio::tests
