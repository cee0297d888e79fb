#include "mapping/surface_grid.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include <catch2/catch.hpp>

namespace {

using namespace nilio::mapping;

const Eigen::Vector3f kSensor(0.0F, 0.0F, 2.0F);

}  // namespace

TEST_CASE("the points of a tilted plane give its mean, normal, thickness and intensity", "[surface_grid]") {
  SurfaceGrid grid(1000);
  const Eigen::Vector3f normal = Eigen::Vector3f(0.3F, -0.2F, 1.0F).normalized();
  const Eigen::Vector3f centre = centre_of({4, -3, 0}, kPlaneVoxelMetres);
  const Eigen::Vector3f along = normal.cross(Eigen::Vector3f::UnitX()).normalized();
  const Eigen::Vector3f across = normal.cross(along);
  int points = 0;
  for (int keyframe = 0; keyframe < 2; ++keyframe) {
    for (int i = -4; i <= 4; ++i) {
      for (int k = -4; k <= 4; ++k) {
        // 1 cm above and below the plane in turn.
        const float height = (i + k + keyframe) % 2 == 0 ? 0.01F : -0.01F;
        grid.add(centre + 0.02F * static_cast<float>(i) * along + 0.02F * static_cast<float>(k) * across +
                     height * normal,
                 10.0F * static_cast<float>(1 + keyframe), kSensor, static_cast<std::uint16_t>(keyframe));
        ++points;
      }
    }
  }
  const auto surfaces = grid.surfaces();
  REQUIRE(surfaces.size() == 1);
  const Surface& surface = surfaces.front();
  CHECK(surface.is_plane);
  CHECK((surface.mean - centre).norm() < 0.001);
  CHECK(surface.normal.dot(normal) > 0.9999);  // towards the sensor above
  CHECK(surface.thickness_m == Approx(0.01).margin(2e-4));
  CHECK(surface.intensity == Approx(15.0));
  CHECK(surface.points == static_cast<std::uint32_t>(points));
  CHECK(surface.keyframe == 1);
}

TEST_CASE("a voxel that one keyframe has seen is left out", "[surface_grid]") {
  SurfaceGrid grid(1000);
  for (int i = 0; i < 10; ++i)
    grid.add({0.04F * static_cast<float>(i), 0.03F * static_cast<float>(i % 4), 0.1F}, 1.0F, kSensor, 7);
  CHECK(grid.surfaces().empty());
}

TEST_CASE("points in all directions become one irregular voxel of twice the size", "[surface_grid]") {
  SurfaceGrid grid(1000);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> within(0.0F, 1.0F);
  Eigen::Vector3f sum = Eigen::Vector3f::Zero();
  for (int i = 0; i < 400; ++i) {
    const Eigen::Vector3f p(2.0F + within(random), -3.0F + within(random), within(random));
    sum += p;
    grid.add(p, 5.0F, kSensor, static_cast<std::uint16_t>(i % 2));
  }
  const auto surfaces = grid.surfaces();
  REQUIRE(surfaces.size() == 1);
  CHECK_FALSE(surfaces.front().is_plane);
  CHECK(surfaces.front().points == 400);
  CHECK((surfaces.front().mean - sum / 400.0F).norm() < 1e-4);
  CHECK(surfaces.front().thickness_m == Approx(std::sqrt(1.0 / 12.0)).epsilon(0.1));
}

TEST_CASE("memory is bounded, and points outside of the grid or not finite are ignored", "[surface_grid]") {
  SurfaceGrid grid(10);
  for (int i = 0; i < 20; ++i) grid.add({static_cast<float>(i), 0.0F, 0.0F}, 1.0F, kSensor, 0);
  CHECK(grid.size() == 10);
  CHECK(grid.refused() == 10);
  grid.add({1e9F, 0.0F, 0.0F}, 1.0F, kSensor, 0);
  grid.add({NAN, 0.0F, 0.0F}, 1.0F, kSensor, 0);
  CHECK(grid.size() == 10);
}

TEST_CASE("a key and its index are each other's inverse up to the limits of the grid", "[surface_grid]") {
  for (const Eigen::Vector3i& index :
       {Eigen::Vector3i(0, 0, 0), Eigen::Vector3i(-512, 511, -1), Eigen::Vector3i(511, -512, 17)}) {
    const auto key = key_of(index);
    REQUIRE(key);
    CHECK(index_of(*key) == index);
  }
  CHECK_FALSE(key_of({512, 0, 0}));
  CHECK_FALSE(key_of({0, -513, 0}));
}
