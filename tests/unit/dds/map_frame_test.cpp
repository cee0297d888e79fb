#include "daemon/mapper/map_frame.hpp"

#include <utility>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using daemon::MapFrame;

namespace {

core::SE3 at(double x, double y, double yaw = 0.0) { return {core::so3_exp({0.0, 0.0, yaw}), {x, y, 0.0}}; }

/// Distance of the vehicle between two corrections.
double distance(const core::SE3& before, const core::SE3& after, const core::SE3& T_odom_base) {
  return ((after * T_odom_base).translation - (before * T_odom_base).translation).norm();
}

}  // namespace

TEST_CASE("a correction enters map to odom gradually, as the vehicle sees it", "[map_frame]") {
  MapFrame frame;
  // Half a degree moves the origin of odom by 9 m, 1 km away from the vehicle, which moves by 0.5 m.
  const core::SE3 T_odom_base = at(1000.0, 0.0);
  const core::SE3 corrected = at(1000.0, 0.5) * at(0.0, 0.0, 0.0087) * T_odom_base.inverse();
  frame.add(0, {1}, core::SE3{});
  frame.add(1, {2}, at(990.0, 0.0));
  CHECK(frame.is_settled());
  const std::vector<std::pair<std::uint32_t, core::SE3>> poses{{0, at(0.0, 0.1)}};
  const MapFrame::Change change = frame.correct(poses, corrected, T_odom_base);
  CHECK_FALSE(change.jumped);
  CHECK(change.distance_m == Approx(0.5));
  CHECK(change.angle_rad == Approx(0.0087));
  CHECK_FALSE(frame.is_settled());
  CHECK(frame.submaps()[0].T_map_submap.translation.y() == 0.1);
  // A submap that is not corrected yet follows.
  CHECK(distance(corrected, frame.submaps()[1].T_map_submap * at(-990.0, 0.0), at(990.0, 0.0)) < 1e-9);
  core::SE3 before = frame.published();
  CHECK(distance(core::SE3{}, before, T_odom_base) == 0.0);
  int steps = 0;
  for (; !frame.is_settled() && steps < 200; ++steps) {
    const core::SE3 now = frame.advance(T_odom_base, core::Duration::from_seconds(0.1));
    CHECK(distance(before, now, T_odom_base) <= 0.0501);
    before = now;
  }
  CHECK(steps > 20);
  CHECK(distance(corrected, frame.published(), T_odom_base) < 1e-9);
}

TEST_CASE("a correction of metres or degrees jumps", "[map_frame]") {
  for (const core::SE3& corrected : {at(2.5, 0.0), at(0.0, 0.0, 0.05)}) {
    MapFrame frame;
    CHECK(frame.correct({}, corrected, core::SE3{}).jumped);
    CHECK_FALSE(frame.is_settled());
    CHECK(distance(corrected, frame.advance(core::SE3{}, core::Duration::from_seconds(0.1)), at(10, 0)) <
          1e-9);
    CHECK(frame.is_settled());
  }
}

TEST_CASE("corrections below a millimetre wait for more, and are not lost", "[map_frame]") {
  MapFrame frame;
  frame.correct({}, at(0.0006, 0.0), core::SE3{});
  CHECK(frame.is_settled());
  frame.correct({}, at(0.0012, 0.0), core::SE3{});
  CHECK_FALSE(frame.is_settled());
}
