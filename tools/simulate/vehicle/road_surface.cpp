#include "tools/simulate/vehicle/road_surface.hpp"

#include "tools/simulate/random.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace nilio::tools::simulate {

namespace {

constexpr double kStepM = 0.05;
constexpr double kReferenceNumber = 0.1;
/// Longest waves of the common profile, and of the difference between the tracks: left and right are coherent
/// for waves longer than about three track widths.
constexpr double kLongWaveNumber = 0.01;
constexpr double kTrackNumber = 0.205;
/// Half width of the mean over the tyre's contact, steps.
constexpr std::ptrdiff_t kContact = 1;

/// White noise through a first-order filter: density roughness * (n0 / n)^2 above `corner`.
std::vector<double> filtered_noise(std::size_t count, double roughness, double corner, RandomStream random) {
  std::vector<double> heights(count);
  const double gain =
      2.0 * std::numbers::pi * kReferenceNumber * std::sqrt(roughness) * kStepM / std::sqrt(2.0 * kStepM);
  const double decay = std::exp(-2.0 * std::numbers::pi * corner * kStepM);
  double z = 0.0;
  for (double& height : heights) {
    z = decay * z + gain * random.gaussian();
    height = z;
  }
  return heights;
}

std::vector<double> contact_mean(const std::vector<double>& heights) {
  std::vector<double> mean(heights.size());
  const auto count = static_cast<std::ptrdiff_t>(heights.size());
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    double sum = 0.0;
    for (std::ptrdiff_t k = -kContact; k <= kContact; ++k)
      sum += heights[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(i + k, 0, count - 1))];
    mean[static_cast<std::size_t>(i)] = sum / (2.0 * kContact + 1.0);
  }
  return mean;
}

}  // namespace

RoadProfile::RoadProfile(const RoadSurface& surface, double from_m, double to_m, std::uint64_t seed)
    : from_m_(from_m) {
  const auto count = static_cast<std::size_t>((to_m - from_m) / kStepM) + 2;
  std::vector<double> common =
      filtered_noise(count, 0.75 * surface.roughness_m3, kLongWaveNumber, RandomStream(seed, 61));
  const std::vector<double> half =
      filtered_noise(count, 0.4 * surface.roughness_m3, kTrackNumber, RandomStream(seed, 62));
  for (std::size_t i = 0; i < count; ++i) {
    const double at = from_m + static_cast<double>(i) * kStepM;
    common[i] +=
        0.5 * surface.washboard_m * std::sin(2.0 * std::numbers::pi * at / surface.washboard_length_m);
  }
  for (const RoadEvent& event : surface.events) {
    const double begin = event.at_m - 0.5 * event.length_m;
    for (double at = begin; at < begin + event.length_m; at += kStepM) {
      const double index = (at - from_m) / kStepM;
      if (index < 0.0 || index >= static_cast<double>(count)) continue;
      const double phase = 2.0 * std::numbers::pi * (at - begin) / event.length_m;
      common[static_cast<std::size_t>(index)] += 0.5 * event.height_m * (1.0 - std::cos(phase));
    }
  }
  std::vector<double> left(count);
  std::vector<double> right(count);
  for (std::size_t i = 0; i < count; ++i) {
    left[i] = common[i] + half[i];
    right[i] = common[i] - half[i];
  }
  left_ = contact_mean(left);
  right_ = contact_mean(right);
}

double RoadProfile::height(double at_m, bool left) const {
  const std::vector<double>& heights = left ? left_ : right_;
  const double index =
      std::clamp((at_m - from_m_) / kStepM, 0.0, static_cast<double>(heights.size()) - 1.001);
  const auto i = static_cast<std::size_t>(index);
  return std::lerp(heights[i], heights[i + 1], index - static_cast<double>(i));
}

}  // namespace nilio::tools::simulate
