#include "nilio/core/se3.hpp"
#include "tools/simulate/scenes/scene.hpp"
#include "tools/simulate/town/town_drive.hpp"

#include <algorithm>
#include <cmath>

#include <catch2/catch.hpp>

using namespace nilio::tools::simulate;

TEST_CASE("every scene is equal for the same seed, different for another, and not empty",
          "[simulate_scenes]") {
  for (const SceneInfo& info : scene_infos()) {
    if (is_town(info.kind)) continue;
    CAPTURE(info.name);
    SceneConfig config;
    config.extent.duration_s = 4.0;
    const auto one = build_scene(info.kind, config);
    const auto same = build_scene(info.kind, config);
    config.seed = 2;
    const auto other = build_scene(info.kind, config);
    REQUIRE(one.ok());
    REQUIRE(same.ok());
    REQUIRE(other.ok());
    CHECK(one->mesh.vertices.size() > 1000);
    CHECK(one->mesh.vertices == same->mesh.vertices);
    CHECK(one->mesh.materials.size() == one->mesh.triangles.size());
    CHECK(one->mesh.vertices != other->mesh.vertices);
    CHECK(one->poses.size() >= 80);
    CHECK(std::all_of(one->poses.begin(), one->poses.end(),
                      [](const nilio::core::SE3& pose) { return pose.matrix().allFinite(); }));
  }
}

TEST_CASE("a bus stops at its halt, stays, and continues at its speed", "[simulate_scenes]") {
  MovingCar bus;
  for (int i = 0; i < 400; ++i) bus.path.emplace_back(i, 0.0, 0.0);
  bus.speed_m_s = 9.0;
  bus.halt_m = 150.0;
  bus.halt_s = 60.0;
  // At 9 m/s it brakes from 33.75 m before.
  const double braking_from_s = (150.0 - 33.75) / 9.0;
  CHECK(bus.travelled_m(braking_from_s) == Approx(150.0 - 33.75));
  CHECK(bus.travelled_m(braking_from_s + 7.5) == Approx(150.0));
  CHECK(bus.travelled_m(braking_from_s + 67.0) == Approx(150.0));
  CHECK(bus.travelled_m(braking_from_s + 75.0) == Approx(150.0 + 33.75));
  CHECK(bus.travelled_m(braking_from_s + 76.0) == Approx(150.0 + 33.75 + 9.0));
}

TEST_CASE("a vehicle that follows a script turns no tighter than it can steer, not even where it turns round",
          "[simulate_scenes]") {
  constexpr double kTightestRadiusM = 5.0;
  constexpr double kSwayRad = 1e-3;
  for (const SceneKind kind : {SceneKind::kReversing, SceneKind::kUTurn, SceneKind::kThreePointTurn}) {
    CAPTURE(info_of(kind).name);
    SceneConfig config;
    config.speed_m_s = info_of(kind).speed_m_s;
    const auto poses = make_scripted_town_drive(kind, config);
    REQUIRE(poses.size() > 100);
    double turned_rad = 0.0;
    for (std::size_t i = 1; i < poses.size(); ++i) {
      const nilio::core::SE3 motion = poses[i - 1].inverse() * poses[i];
      const double yaw_rad = std::abs(nilio::core::so3_log(motion.rotation).z());
      CHECK(yaw_rad <= motion.translation.norm() / kTightestRadiusM + kSwayRad);
      turned_rad += yaw_rad;
    }
    CHECK(turned_rad > 1.4);
  }
}
