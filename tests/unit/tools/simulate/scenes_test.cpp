#include "tools/simulate/scenes/scene.hpp"

#include <algorithm>

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
