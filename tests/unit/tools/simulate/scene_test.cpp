#include "tests/support/tools/simulate_support.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <set>
#include <utility>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools::simulate;
using core::SE3;
using core::Vector3;
using tests::SimulatedWorld;

namespace {

/// Rays over 1.5 m of road in front of the vehicle's axles, across its width and height.
std::vector<std::pair<Vector3, Vector3>> sweep(const SE3& T_world_base) {
  // Casting starts 0.4 m after the origin.
  constexpr double back = -0.45;
  std::vector<std::pair<Vector3, Vector3>> rays;
  for (const double y : {-0.95, -0.5, 0.0, 0.5, 0.95}) {
    for (const double z : {0.35, 0.8, 1.4, 2.0}) {
      rays.emplace_back(T_world_base * Vector3(back, y, z), T_world_base.rotation * Vector3::UnitX());
    }
  }
  return rays;
}

/// Number of times that an object is in the path of the vehicle.
int count_obstacles(const SimulatedWorld& world, double speed_step_s) {
  int obstacles = 0;
  for (double t = 0.0; t < world.trajectory.duration_s(); t += speed_step_s) {
    for (const float distance : tests::cast_rays(world.scene, sweep(world.trajectory.pose(t)), t, 1.5F)) {
      obstacles += distance > 0.0F ? 1 : 0;
    }
  }
  return obstacles;
}

/// A figure of eight of two circles, driven twice at 8 m/s: it crosses itself and returns on its own lane.
std::vector<SE3> figure_of_eight() {
  constexpr double radius = 22.0;
  std::vector<SE3> poses;
  for (double s = 0.0; s < 2.0 * 4.0 * std::numbers::pi * radius; s += 8.0 * kControlIntervalS) {
    const double turn = std::fmod(s / radius, 4.0 * std::numbers::pi);
    const double way = turn < 2.0 * std::numbers::pi ? 1.0 : -1.0;
    const double yaw = way * std::fmod(turn, 2.0 * std::numbers::pi);
    poses.push_back({core::so3_exp({0.0, 0.0, yaw}),
                     {way * radius * std::sin(yaw), way * radius * (1.0 - std::cos(yaw)), 0.0}});
  }
  return poses;
}

}  // namespace

TEST_CASE("the driven lane is free of objects on all passes, and no moving car collides with the vehicle",
          "[simulate_scene]") {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    TownDriveConfig config;
    config.seed = seed;
    const SimulatedWorld world = tests::make_world(make_town_drive(config), seed, 20);
    CHECK(world.town.summary.buildings > 20);
    CHECK(world.town.summary.parked_cars > 5);
    CHECK(world.scene.cars().size() > 5);
    CHECK(count_obstacles(world, 0.05) == 0);
  }
}

TEST_CASE("a drive that crosses itself has a free lane at the crossing, too", "[simulate_scene]") {
  const SimulatedWorld world = tests::make_world(figure_of_eight(), 7, 10);
  CHECK(world.town.summary.buildings > 3);
  CHECK(count_obstacles(world, 0.05) == 0);
}

TEST_CASE("the ground is at the height of the vehicle", "[simulate_scene]") {
  const SimulatedWorld world = tests::make_world(make_town_drive({}), 1, 0);
  for (double t = 2.0; t < world.trajectory.duration_s(); t += 0.7) {
    const Vector3 base = world.trajectory.pose(t).translation;
    CHECK(std::abs(world.town.ground.height(base.head<2>()) - base.z()) < 0.08);
  }
}

TEST_CASE("moving cars move on the ground and along their heading", "[simulate_scene]") {
  const SimulatedWorld world = tests::make_world(make_town_drive({}), 1, 15);
  std::size_t seen = 0;
  for (const MovingCar& car : world.scene.cars()) {
    for (double t = 0.0; t < world.trajectory.duration_s(); t += 0.5) {
      const auto now = car.pose(t);
      const auto later = car.pose(t + 0.1);
      if (!now || !later) continue;
      ++seen;
      const Vector3 step = now->inverse() * later->translation;
      CHECK(step.x() == Approx(0.1 * car.speed_m_s).epsilon(0.25));
      CHECK(std::abs(step.y()) < 0.35);
      const Vector3& p = now->translation;
      CHECK(std::abs(world.town.ground.height(p.head<2>()) - p.z()) < 0.05);
    }
  }
  CHECK(seen > 50);
}

TEST_CASE("density 0 gives empty streets and density 1 buildings", "[simulate_scene]") {
  TownDriveConfig config;
  config.extent.length_m = 150.0;
  const VehicleTrajectory trajectory(make_town_drive(config), kControlIntervalS);
  const auto bare = build_town(trajectory, {1, 0.0});
  REQUIRE(bare.ok());
  CHECK(bare->summary.buildings + bare->summary.trees + bare->summary.parked_cars + bare->summary.posts == 0);
  const auto full = build_town(trajectory, {1, 1.0});
  REQUIRE(full.ok());
  CHECK(full->summary.buildings > 8);
  CHECK(full->mesh.triangles.size() > bare->mesh.triangles.size());
}

TEST_CASE("two visits of a town have the houses in common and four fifths of the plants",
          "[simulate_scene]") {
  TownDriveConfig config;
  config.extent.length_m = 800.0;
  const VehicleTrajectory trajectory(make_town_drive(config), kControlIntervalS);
  // A bush and a crown stand where no other one does.
  std::array<std::set<std::pair<float, float>>, 3> plants;
  std::array<std::size_t, 3> buildings{};
  for (const std::size_t visit : {0U, 1U, 2U}) {
    const auto town =
        build_town(trajectory, {1, 1.0, true, true, visit == 0 ? std::nullopt : std::optional(visit)});
    REQUIRE(town.ok());
    buildings[visit] = town->summary.buildings;
    for (const PorousVolume& volume : town->mesh.volumes)
      plants[visit].emplace(volume.centre.x(), volume.centre.y());
  }
  CHECK(buildings[0] > 15);
  CHECK(buildings[1] == buildings[0]);
  CHECK(buildings[2] == buildings[0]);
  REQUIRE(plants[0].size() > 150);
  std::size_t common = 0;
  std::size_t either = 0;
  for (const auto& plant : plants[0]) {
    common += plants[1].count(plant) > 0 && plants[2].count(plant) > 0 ? 1 : 0;
    either += plants[1].count(plant) > 0 || plants[2].count(plant) > 0 ? 1 : 0;
  }
  CHECK(std::includes(plants[0].begin(), plants[0].end(), plants[1].begin(), plants[1].end()));
  CHECK(static_cast<double>(common) / static_cast<double>(either) == Approx(0.8).margin(0.06));
}
