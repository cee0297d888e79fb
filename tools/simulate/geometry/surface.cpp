#include "tools/simulate/geometry/surface.hpp"

#include "tools/simulate/geometry/porous_volume.hpp"
#include "tools/simulate/random.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace nilio::tools::simulate {

namespace {

constexpr float kRoughCellM = 0.3F;
/// Limits the displacement along a grazing ray.
constexpr float kLeastCosine = 0.5F;

/// Amplitude of a surface's unevenness over decimetres, m; its rms is 0.37 of it. Ground by ISO 8608 between
/// wavelengths of 0.3 and 1 m: class B (asphalt) 0.7 mm rms, C (pavement) twice as much, E (soil) eight
/// times.
float unevenness(Material material) {
  // In the order of the enumeration; plants and wires have their own structure.
  static constexpr std::array<float, 14> values{
      0.002F,  // asphalt
      0.004F,  // pavement
      0.020F,  // grass
      0.020F,  // plaster
      0.020F,  // brick
      0.002F,  // glass
      0.030F,  // roof tile
      0.004F,  // metal
      0.030F,  // bark
      0.0F,    // foliage
      0.002F,  // car paint
      0.005F,  // tyre
      0.0F,    // retroreflector
      0.0F,    // wire
  };
  return values[static_cast<std::size_t>(material)];
}

}  // namespace

float lattice_noise(const Eigen::Vector3f& p, float cell_m, std::uint64_t key) {
  const Eigen::Vector3f scaled = p / cell_m;
  const Eigen::Vector3f corner = scaled.array().floor().matrix();
  const Eigen::Vector3f t = scaled - corner;
  const Eigen::Vector3f blend = t.cwiseProduct(t).cwiseProduct(Eigen::Vector3f::Constant(3.0F) - 2.0F * t);
  constexpr std::uint64_t mask = (1U << 21U) - 1U;
  const auto index = [&](float v) { return static_cast<std::uint64_t>(static_cast<std::int64_t>(v)) & mask; };
  float sum = 0.0F;
  for (unsigned k = 0; k < 8; ++k) {
    const Eigen::Vector3f step((k & 1U) != 0 ? 1.0F : 0.0F, (k & 2U) != 0 ? 1.0F : 0.0F,
                               (k & 4U) != 0 ? 1.0F : 0.0F);
    const Eigen::Vector3f node = corner + step;
    const std::uint64_t word =
        mix_bits((index(node.x()) | index(node.y()) << 21U | index(node.z()) << 42U) ^ key);
    const float value = 2.0F * static_cast<float>(to_unit_interval(word)) - 1.0F;
    float weight = 1.0F;
    for (int axis = 0; axis < 3; ++axis) weight *= step[axis] > 0.5F ? blend[axis] : 1.0F - blend[axis];
    sum += weight * value;
  }
  return sum;
}

void add_detail(const SurfaceDetail& detail, const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                RayHit& hit) {
  if (detail.grass_m > 0.0F && hit.material == Material::kGrass) {
    const auto blade = cast_at_grass(origin, direction, hit.distance_m, hit.incidence_cosine, detail.grass_m);
    if (blade) {
      hit.distance_m = *blade;
      hit.incidence_cosine = 0.6F;
      hit.material = Material::kFoliage;
      return;
    }
  }
  if (!detail.rough) return;
  const float amplitude = unevenness(hit.material);
  if (amplitude <= 0.0F) return;
  const Eigen::Vector3f p = origin + hit.distance_m * direction;
  hit.distance_m +=
      amplitude * lattice_noise(p, kRoughCellM, 0x526F756768U) / std::max(hit.incidence_cosine, kLeastCosine);
}

double reflectivity(Material material) {
  // In the order of the enumeration.
  static constexpr std::array<double, 14> values{
      0.2,   // asphalt
      0.35,  // pavement
      0.4,   // grass
      0.65,  // plaster
      0.35,  // brick
      0.08,  // glass
      0.3,   // roof tile
      0.45,  // metal
      0.3,   // bark
      0.5,   // foliage
      0.5,   // car paint
      0.06,  // tyre
      1.8,   // retroreflector
      0.3,   // wire
  };
  return values[static_cast<std::size_t>(material)];
}

}  // namespace nilio::tools::simulate
