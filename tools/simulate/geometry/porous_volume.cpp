#include "tools/simulate/geometry/porous_volume.hpp"

#include "tools/simulate/random.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nilio::tools::simulate {

namespace {

using Eigen::Vector3f;

/// Cell coordinates as one word: 21 bits each.
std::uint64_t cell_key(const Vector3f& p, float inverse_cell) {
  constexpr std::uint64_t mask = (1U << 21U) - 1U;
  const auto index = [&](float v) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(v * inverse_cell))) & mask;
  };
  return index(p.x()) | index(p.y()) << 21U | index(p.z()) << 42U;
}

float unit(std::uint64_t word, unsigned shift) {
  return static_cast<float>((word >> shift) & 0xFFFFU) * (1.0F / 65536.0F);
}

/// Part of a ray inside the body, in body axes; unset = outside.
std::optional<std::array<float, 2>> span_inside(const PorousVolume& volume, const Vector3f& o,
                                                const Vector3f& d) {
  float enter = 0.0F;
  float leave = 0.0F;
  if (volume.shape == PorousVolume::Shape::kEllipsoid) {
    const Vector3f so = o.cwiseQuotient(volume.half_size);
    const Vector3f sd = d.cwiseQuotient(volume.half_size);
    const float a = sd.squaredNorm();
    const float b = so.dot(sd);
    const float disc = b * b - a * (so.squaredNorm() - 1.0F);
    if (disc <= 0.0F) return std::nullopt;
    const float root = std::sqrt(disc);
    enter = (-b - root) / a;
    leave = (-b + root) / a;
  } else {
    enter = -1e9F;
    leave = 1e9F;
    for (int axis = 0; axis < 3; ++axis) {
      if (std::abs(d[axis]) < 1e-9F) {
        if (std::abs(o[axis]) > volume.half_size[axis]) return std::nullopt;
        continue;
      }
      const float one = (-volume.half_size[axis] - o[axis]) / d[axis];
      const float two = (volume.half_size[axis] - o[axis]) / d[axis];
      enter = std::max(enter, std::min(one, two));
      leave = std::min(leave, std::max(one, two));
    }
  }
  if (leave <= enter) return std::nullopt;
  return std::array<float, 2>{enter, leave};
}

constexpr float kGrassCellM = 0.05F;
/// Leaf area index 1.5 over the layer's height, half of it across the ray.
constexpr float kGrassArea = 0.75F;
constexpr float kLongestInGrassM = 1.5F;

}  // namespace

std::optional<PorousHit> cast_at_volume(const PorousVolume& volume, std::uint64_t key, const Vector3f& origin,
                                        const Vector3f& direction, float near_m, float far_m) {
  const auto into_body = [&](const Vector3f& v) {
    return Vector3f(volume.cos_yaw * v.x() + volume.sin_yaw * v.y(),
                    volume.cos_yaw * v.y() - volume.sin_yaw * v.x(), v.z());
  };
  const Vector3f o = into_body(origin - volume.centre);
  const Vector3f d = into_body(direction);
  const auto span = span_inside(volume, o, d);
  if (!span) return std::nullopt;
  const float first = std::max((*span)[0], near_m);
  const float last = std::min((*span)[1], far_m);
  const float inverse_cell = 1.0F / volume.cell_m;
  for (float at = first; at < last; at += volume.cell_m) {
    const float step = std::min(volume.cell_m, last - at);
    const float middle = at + 0.5F * step;
    const Vector3f p = o + middle * d;
    const std::uint64_t word = mix_bits(cell_key(p, inverse_cell) ^ key);
    if (unit(word, 0) >= 1.0F - std::exp(-volume.extinction * step)) continue;
    // The leaf has a place in the cell, so that neighbouring rays find it at the same distance.
    const Vector3f corner = (p * inverse_cell).array().floor().matrix() * volume.cell_m;
    const Vector3f leaf = corner + volume.cell_m * Vector3f(unit(word, 16), unit(word, 32), unit(word, 48));
    const std::uint64_t turn = mix_bits(word);
    const Vector3f tilt(unit(turn, 0) - 0.5F, unit(turn, 16) - 0.5F, unit(turn, 32) - 0.5F);
    const float distance = std::clamp((leaf - o).dot(d), at, at + step);
    return PorousHit{distance, tilt};
  }
  return std::nullopt;
}

std::optional<float> cast_at_grass(const Vector3f& origin, const Vector3f& direction, float ground_m,
                                   float incidence_cosine, float height_m) {
  const float path = std::min(height_m / std::max(incidence_cosine, 0.01F), kLongestInGrassM);
  const float extinction = kGrassArea / height_m;
  for (float at = std::max(0.0F, ground_m - path); at < ground_m; at += kGrassCellM) {
    const Vector3f p = origin + at * direction;
    const std::uint64_t word = mix_bits(cell_key(p, 1.0F / kGrassCellM));
    // Blades end at different heights: the upper part of the layer is sparser.
    const float above = (ground_m - at) * incidence_cosine / height_m;
    const float density = extinction * 2.0F * std::max(0.0F, 1.0F - above);
    if (unit(word, 0) < 1.0F - std::exp(-density * kGrassCellM))
      return std::min(at + kGrassCellM * unit(word, 16), ground_m);
  }
  return std::nullopt;
}

}  // namespace nilio::tools::simulate
