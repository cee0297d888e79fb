#pragma once

#include <cstdint>

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

}  // namespace nilio::tools::simulate
