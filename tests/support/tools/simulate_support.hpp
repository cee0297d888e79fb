#pragma once

#include "tests/support/temporary_folder.hpp"
#include "tools/simulate/geometry/ray_scene.hpp"
#include "tools/simulate/scenes/traffic.hpp"
#include "tools/simulate/town/town.hpp"
#include "tools/simulate/town/town_drive.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <memory>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

namespace nilio::tests {

/// A drive, the town around it and the moving cars, ready for casting.
struct SimulatedWorld {
  tools::simulate::VehicleTrajectory trajectory;
  tools::simulate::Town town;
  tools::simulate::RayScene scene;
};

inline SimulatedWorld make_world(const std::vector<core::SE3>& poses, std::uint64_t seed,
                                 std::size_t moving_cars) {
  using namespace tools::simulate;
  VehicleTrajectory trajectory(poses, kControlIntervalS);
  auto town = build_town(trajectory, {seed, 1.0});
  REQUIRE(town.ok());
  auto scene =
      RayScene::create(town->mesh, make_traffic(trajectory, town->layout, town->ground, moving_cars, seed));
  REQUIRE(scene.ok());
  return {std::move(trajectory), std::move(town).value(), std::move(scene).value()};
}

/// Distance to the first surface on each ray; 0 = none.
inline std::vector<float> cast_rays(const tools::simulate::RayScene& scene,
                                    const std::vector<std::pair<core::Vector3, core::Vector3>>& rays,
                                    double time_s, float max_distance_m) {
  using namespace tools::simulate;
  std::vector<float> distances;
  for (std::size_t first = 0; first < rays.size(); first += kRayGroup) {
    RayGroup group;
    for (std::size_t i = 0; i < kRayGroup; ++i) {
      const auto& [origin, direction] = rays[std::min(first + i, rays.size() - 1)];
      group.origin[i] = origin.cast<float>();
      group.direction[i] = direction.normalized().cast<float>();
      group.time_s[i] = time_s;
    }
    std::vector<NearbyCar> cars;
    scene.find_cars(time_s, rays[first].first, 120.0, cars);
    std::array<RayHit, kRayGroup> hits;
    scene.cast(group, max_distance_m, cars, hits);
    for (std::size_t i = 0; i < kRayGroup && first + i < rays.size(); ++i) {
      distances.push_back(hits[i].hit ? hits[i].distance_m : 0.0F);
    }
  }
  return distances;
}

}  // namespace nilio::tests
