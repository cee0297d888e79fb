#pragma once

#include <cstdint>

#include <Eigen/Core>

namespace nilio::tools::simulate {

enum class Material : std::uint8_t {
  kAsphalt,
  kPavement,
  kGrass,
  kPlaster,
  kBrick,
  kGlass,
  kRoofTile,
  kMetal,
  kBark,
  kFoliage,
  kCarPaint,
  kTyre,
  kRetroreflector,
  kWire,
};

/// Share of light at the laser's wavelength (905 nm) that is reflected diffusely, 0 to 1. A retroreflector
/// reflects more than a white diffuse surface and has more than 1.
double reflectivity(Material material);

/// First surface on a ray.
struct RayHit {
  bool hit = false;
  float distance_m = 0.0F;
  /// Cosine of the angle between ray and surface normal, 0 (grazing) to 1.
  float incidence_cosine = 0.0F;
  Material material = Material::kAsphalt;
};

/// Properties of surfaces that the triangles do not have.
struct SurfaceDetail {
  /// Height of the grass on Material::kGrass, m; 0 = bare ground.
  float grass_m = 0.0F;
  /// Whether surfaces are uneven over decimetres.
  bool rough = false;
};

/// Moves the hit to a blade of grass, or by the unevenness of the surface.
void add_detail(const SurfaceDetail& detail, const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                RayHit& hit);

/// Smooth noise in [-1, 1] over a lattice of `cell_m` in space.
float lattice_noise(const Eigen::Vector3f& p, float cell_m, std::uint64_t key);

}  // namespace nilio::tools::simulate
