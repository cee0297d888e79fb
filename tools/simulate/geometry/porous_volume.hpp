#pragma once

#include "nilio/core/se3.hpp"

#include "tools/simulate/geometry/surface.hpp"

#include <cstdint>
#include <optional>

#include <Eigen/Core>

namespace nilio::tools::simulate {

/// A body that light enters: a crown, a hedge, wire mesh. The probability of no hit over a path s is
/// exp(-extinction * s) (Beer-Lambert; for leaves the extinction is half of the leaf area density). Whether a
/// cell of it is occupied is a hash of the cell, not of the ray or the time: leaves stay in place.
struct PorousVolume {
  enum class Shape : std::uint8_t { kEllipsoid, kBox };

  Eigen::Vector3f centre = Eigen::Vector3f::Zero();
  /// Cosine and sine of the yaw of the body's x axis.
  float cos_yaw = 1.0F;
  float sin_yaw = 0.0F;
  Eigen::Vector3f half_size = Eigen::Vector3f::Ones();
  Shape shape = Shape::kEllipsoid;
  /// 1/m.
  float extinction = 0.5F;
  float cell_m = 0.1F;
  Material material = Material::kFoliage;
};

/// First occupied cell on a ray.
struct PorousHit {
  float distance_m = 0.0F;
  Eigen::Vector3f normal;
};

/// Casts a ray (unit direction) at a body between two distances; `key` separates the bodies' hashes.
std::optional<PorousHit> cast_at_volume(const PorousVolume& volume, std::uint64_t key,
                                        const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                                        float near_m, float far_m);

/// First blade of grass before the ground at `ground_m`, in a layer `height_m` thick that the ray crosses
/// with the given cosine to its normal. Unset = the ray reaches the ground.
std::optional<float> cast_at_grass(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                                   float ground_m, float incidence_cosine, float height_m);

}  // namespace nilio::tools::simulate
