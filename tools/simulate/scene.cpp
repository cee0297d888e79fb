#include "tools/simulate/scene.hpp"

#include "tools/simulate/scenes/traffic.hpp"
#include "tools/simulate/town/town.hpp"
#include "tools/simulate/town/town_drive.hpp"
#include "tools/simulate/vehicle/recorded_drive.hpp"

#include <cmath>
#include <cstdio>
#include <utility>
#include <vector>

namespace nilio::tools {

using core::Result;
using core::SE3;
using namespace simulation;

namespace {

constexpr double kMetresPerMovingCar = 30.0;

Result<std::vector<SE3>> make_town_poses(const SimulateArguments& arguments, const SE3& T_base_lidar) {
  if (arguments.trajectory == "town") {
    const SceneInfo& scene = scene_of(arguments);
    return make_town_drive({arguments.seed, arguments.speed_m_s.value_or(scene.speed_m_s),
                            arguments.moving_start, arguments.extent, scene.kind == SceneKind::kManoeuvres});
  }
  return make_recorded_drive({arguments.trajectory, arguments.calibration, arguments.pose_interval_s,
                              arguments.moving_start, T_base_lidar, arguments.extent});
}

/// Recorded heights can be wrong by more than the closing of loops repairs.
void warn_off_ground(const Town& town) {
  constexpr double tolerated_m = 0.5;
  double worst_m = 0.0;
  double time_s = 0.0;
  for (const StreetSample& sample : town.layout.samples()) {
    const double gap_m = std::abs(town.ground.height(sample.position) - sample.z);
    if (!sample.driven || gap_m <= worst_m) continue;
    worst_m = gap_m;
    time_s = sample.time_s;
  }
  if (worst_m < tolerated_m) return;
  std::fprintf(
      stderr,
      "nilio simulate: warning: %.1f s into the drive the vehicle is %.1f m off the ground: the pose file's "
      "heights are not those of one road; cut those lines from it\n",
      time_s, worst_m);
}

std::string describe(const Town& town) {
  const TownSummary& s = town.summary;
  return counted(s.buildings, "buildings, ") + counted(s.trees, "trees, ") + counted(s.bushes, "bushes, ") +
         counted(s.parked_cars, "parked cars, ") + counted(s.posts, "lamps and signs, ") +
         counted(s.walls, "garden walls, ") + counted(town.layout.side_streets().size(), "side streets");
}

Result<Scene> make_town_scene(const SimulateArguments& arguments, const SE3& T_base_lidar) {
  Result<std::vector<SE3>> poses = make_town_poses(arguments, T_base_lidar);
  if (!poses) return poses.error();
  const VehicleTrajectory trajectory(*poses, kControlIntervalS);
  Result<Town> town = build_town(trajectory, {arguments.seed, arguments.scene_density});
  if (!town) return town.error();
  warn_off_ground(*town);
  const std::size_t wanted_cars =
      arguments.moving_cars.value_or(static_cast<unsigned>(path_length(*poses) / kMetresPerMovingCar));
  Scene scene;
  scene.cars = make_traffic(trajectory, town->layout, town->ground, wanted_cars, arguments.seed);
  scene.poses = std::move(*poses);
  scene.contents = describe(*town);
  scene.mesh = std::move(town->mesh);
  return scene;
}

}  // namespace

Result<Scene> make_scene(const SimulateArguments& arguments, const SE3& T_base_lidar) {
  const SceneKind kind = scene_of(arguments).kind;
  if (kind == SceneKind::kTown || kind == SceneKind::kManoeuvres)
    return make_town_scene(arguments, T_base_lidar);
  SceneConfig config;
  config.seed = arguments.seed;
  config.extent = arguments.extent;
  config.speed_m_s = arguments.speed_m_s;
  config.moving_start = arguments.moving_start;
  config.density = arguments.scene_density;
  config.moving_cars = arguments.moving_cars;
  config.tunnel_lamps = arguments.tunnel_lamps;
  return build_scene(kind, config);
}

}  // namespace nilio::tools
