#pragma once

#include "nilio/core/result.hpp"

#include "tools/simulate/geometry/mesh.hpp"
#include "tools/simulate/town/ground.hpp"
#include "tools/simulate/town/street_layout.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <cstdint>
#include <optional>

namespace nilio::tools::simulate {

struct TownConfig {
  std::uint64_t seed = 1;
  /// Scales the number of buildings, trees, parked cars and posts; 0 leaves streets and ground.
  double density = 1.0;
  /// Plants that light enters.
  bool porous_plants = false;
  /// Hedges, fences, wires, bins, bicycles and persons beside the street.
  bool clutter = false;
  /// Another time: each object but houses is missing by chance, so that two visits differ in 20 % of them,
  /// and other cars are parked.
  std::optional<std::uint64_t> visit = std::nullopt;
};

struct TownSummary {
  std::size_t buildings = 0;
  std::size_t trees = 0;
  std::size_t bushes = 0;
  std::size_t parked_cars = 0;
  std::size_t posts = 0;
  std::size_t walls = 0;
  std::size_t clutter = 0;
};

/// All static geometry, in world coordinates.
struct Town {
  StreetLayout layout;
  Ground ground;
  TriangleMesh mesh;
  TownSummary summary;
};

/// Builds a town around a drive: uneven ground, kerbs, buildings, garden walls, trees, posts and parked cars.
/// The same drive and configuration give the same town. The driven lane is free of objects on all passes.
core::Result<Town> build_town(const VehicleTrajectory& trajectory, const TownConfig& config);

}  // namespace nilio::tools::simulate
