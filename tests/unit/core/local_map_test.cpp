#include "core/src/map/local_map.hpp"

#include "tests/support/sweep_of_scan.hpp"
#include "tests/support/synthetic_room.hpp"

#include <catch2/catch.hpp>

using namespace nilio::core;
using nilio::tests::Room;
using nilio::tests::scan_room;
using nilio::tests::sweep_of;
using nilio::tests::TestSweep;

namespace {

TestSweep sweep_of_room() {
  return sweep_of(scan_room(
      Room::with_pillars(), [](double) { return SE3{}; }, 0.0, 0));
}

OdometryConfig small_map() {
  OdometryConfig config;
  config.map_radius_m = 50.0;
  return config;
}

}  // namespace

TEST_CASE("a sweep enters planes and Gaussians, and points only where a method needs them", "[local_map]") {
  const TestSweep scan = sweep_of_room();
  LocalMap map(small_map(), false);
  map.reset(1.5);
  map.insert(scan.sweep, scan.points, SE3{}, kCoarseVoxelMetres);
  CHECK(map.planes().size() > 300);
  CHECK(map.gaussians().size() > 200);
  CHECK(map.points() == nullptr);
  CHECK(map.plane_voxel_m() == 1.5);
  CHECK(map.refused() == 0);

  LocalMap with_points(small_map(), true);
  with_points.insert(scan.sweep, scan.points, SE3{}, kCoarseVoxelMetres);
  REQUIRE(with_points.points() != nullptr);
  CHECK(with_points.points()->size() > 300);

  map.reset(2.0);
  CHECK(map.planes().size() == 0);
  CHECK(map.gaussians().size() == 0);
  CHECK(map.plane_voxel_m() == 2.0);
}

TEST_CASE("a vehicle is elsewhere after 2 cm or a tenth of a degree since the last insertion",
          "[local_map]") {
  const TestSweep scan = sweep_of_room();
  LocalMap map(small_map(), false);
  const SE3 T_inserted{so3_exp(Vector3(0.0, 0.0, 0.7)), Vector3(3.0, 4.0, 0.0)};
  map.insert(scan.sweep, scan.points, T_inserted, kCoarseVoxelMetres);
  const auto is_elsewhere = [&](double x, double yaw) {
    return map.is_elsewhere(T_inserted * SE3{so3_exp(Vector3(0.0, 0.0, yaw)), Vector3(x, 0.0, 0.0)});
  };
  CHECK_FALSE(is_elsewhere(0.0, 0.0));
  CHECK_FALSE(is_elsewhere(0.015, 0.0015));
  CHECK(is_elsewhere(0.025, 0.0));
  CHECK(is_elsewhere(0.0, 0.0025));
}

TEST_CASE("what the vehicle leaves behind is evicted from every reading", "[local_map]") {
  const TestSweep scan = sweep_of_room();
  LocalMap map(small_map(), true);
  map.insert(scan.sweep, scan.points, SE3{}, kCoarseVoxelMetres);
  for (int i = 0; i < 20; ++i) map.evict_far_from(Vector3(1000.0, 0.0, 0.0));
  CHECK(map.planes().size() == 0);
  CHECK(map.gaussians().size() == 0);
  CHECK(map.points()->size() == 0);
}
