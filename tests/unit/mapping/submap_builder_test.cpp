#include "mapping/submap_builder.hpp"

#include "tests/support/street.hpp"

#include <map>
#include <set>
#include <tuple>
#include <vector>

#include <catch2/catch.hpp>

namespace {

using namespace nilio;
using namespace nilio::mapping;
using nilio::tests::street_keyframe;

std::vector<Submap> build(int keyframes, const SubmapConfig& config = {}) {
  std::vector<Submap> submaps;
  SubmapBuilder builder(config, [&](const Submap& submap) { submaps.push_back(submap); });
  for (int i = 0; i < keyframes; ++i) builder.add(street_keyframe(i));
  builder.finish();
  return submaps;
}

using Cell = std::tuple<int, int, int>;

Cell cell_of(const core::Vector3& p) {
  return {static_cast<int>(std::floor(p.x() / 0.5)), static_cast<int>(std::floor(p.y() / 0.5)),
          static_cast<int>(std::floor(p.z() / 0.5))};
}

}  // namespace

TEST_CASE("submaps are 50 m long, overlap by half, and cover the whole drive", "[submap_builder]") {
  const auto submaps = build(160);
  // Stretches begin at 0, 26, 52, 78, 104, 130, 156 m: the keyframe that reaches 25 m is the last of its own.
  REQUIRE(submaps.size() == 7);
  for (std::size_t i = 0; i < submaps.size(); ++i) {
    CHECK(submaps[i].id == i);
    CHECK(submaps[i].keyframes.front().stamp.ns == street_keyframe(26 * static_cast<int>(i)).stamp.ns);
  }
  for (std::size_t i = 0; i + 2 < submaps.size(); ++i) CHECK(submaps[i].keyframes.size() == 52);
  CHECK(submaps.back().keyframes.back().stamp.ns == street_keyframe(159).stamp.ns);
}

TEST_CASE("the surfaces of all submaps are those of the street, each voxel in one submap",
          "[submap_builder]") {
  std::map<Cell, int> stored;
  double square_sum = 0.0;
  double worst_normal = 1.0;
  std::size_t planes = 0;
  for (const Submap& submap : build(120)) {
    for (const Surface& surface : submap.surfaces) {
      if (!surface.is_plane) continue;
      const core::Vector3 p = submap.T_odom_submap * surface.mean.cast<double>();
      ++stored[cell_of(p)];
      // A voxel with ground and wall has neither's normal.
      if (std::abs(p.y() - 0.3) > 7.2 && std::abs(p.z()) < 0.51) continue;
      ++planes;
      const bool is_wall = std::abs(surface.normal.y()) > 0.7F;
      const double distance = is_wall ? std::abs(std::abs(p.y() - 0.3) - 8.0) : std::abs(p.z());
      square_sum += distance * distance;
      // Towards the vehicle: walls face the middle of the street, the ground faces upwards.
      const double facing =
          is_wall ? -surface.normal.y() * (p.y() - 0.3 > 0 ? 1.0 : -1.0) : surface.normal.z();
      worst_normal = std::min(worst_normal, facing);
    }
  }
  REQUIRE(planes > 3000);
  CHECK(std::sqrt(square_sum / static_cast<double>(planes)) < 0.001);
  CHECK(worst_normal > 0.99);
  std::size_t twice = 0;
  for (const auto& [cell, count] : stored) twice += count > 1 ? 1 : 0;
  CHECK(static_cast<double>(twice) < 0.01 * static_cast<double>(stored.size()));
  // The ground between the walls, 0.5 m cells, over the whole drive.
  std::size_t ground = 0;
  std::size_t seen = 0;
  for (int x = 0; x < 238; ++x) {
    for (int y = -14; y < 15; ++y) {
      ++ground;
      seen += stored.contains({x, y, 0}) || stored.contains({x, y, -1}) ? 1 : 0;
    }
  }
  CHECK(static_cast<double>(seen) > 0.97 * static_cast<double>(ground));
}

TEST_CASE("a slow drive closes submaps by time in motion, a stationary vehicle does not",
          "[submap_builder]") {
  std::vector<Submap> submaps;
  SubmapBuilder builder({}, [&](const Submap& submap) { submaps.push_back(submap); });
  const auto keyframe_at = [](int i, std::int64_t ns) {
    Keyframe keyframe = street_keyframe(i, 30);
    keyframe.stamp = {ns};
    return keyframe;
  };
  // One metre each 1.5 s: 9 intervals reach 12.5 s.
  std::uint32_t stretch = 0;
  for (int i = 0; i < 10; ++i) stretch = builder.add(keyframe_at(i, i * 1'500'000'000LL));
  CHECK(stretch == 0);
  CHECK(builder.add(keyframe_at(10, 15'000'000'000LL)) == 1);
  // An hour at a place counts as two seconds.
  CHECK(builder.add(keyframe_at(11, 3'615'000'000'000LL)) == 1);
  CHECK(builder.add(keyframe_at(12, 3'616'000'000'000LL)) == 1);
}

TEST_CASE("a builder that continues after a stored submap does not store its voxels again",
          "[submap_builder]") {
  const auto whole = build(120);
  // The first two submaps are stored; a new process gets the keyframes from stretch 2 on.
  std::vector<Submap> rest;
  SubmapBuilder builder(
      {}, [&](const Submap& submap) { rest.push_back(submap); }, 2);
  builder.continue_after(whole[0]);
  builder.continue_after(whole[1]);
  for (int i = 52; i < 120; ++i) builder.add(street_keyframe(i));
  builder.finish();
  REQUIRE(rest.size() + 2 == whole.size());
  for (std::size_t i = 0; i < rest.size(); ++i) {
    CHECK(rest[i].id == whole[i + 2].id);
    CHECK(rest[i].keyframes.size() == whole[i + 2].keyframes.size());
    CHECK(rest[i].surfaces.size() == Approx(whole[i + 2].surfaces.size()).epsilon(0.05));
  }
}

TEST_CASE("the local map is that of the last 25 to 50 m, and points beyond the range are left out",
          "[submap_builder]") {
  SubmapBuilder builder({.range_m = 10.0}, [](const Submap&) {});
  CHECK_FALSE(builder.local_map());
  for (int i = 0; i < 100; ++i) builder.add(street_keyframe(i));
  const auto local = builder.local_map();
  REQUIRE(local);
  const double start = local->T_odom_submap.translation.x();
  CHECK(start > 99.0 - 53.0);
  CHECK(start < 99.0 - 21.0);
  for (const Surface& surface : local->surfaces) {
    const double x = start + static_cast<double>(surface.mean.x());
    CHECK(x > start - 12.0);
    CHECK(x < 111.0);
  }
}

TEST_CASE("the same keyframes give the same submaps bit by bit", "[submap_builder]") {
  const auto first = build(60);
  const auto second = build(60);
  REQUIRE(first.size() == second.size());
  for (std::size_t i = 0; i < first.size(); ++i) {
    REQUIRE(first[i].surfaces.size() == second[i].surfaces.size());
    for (std::size_t k = 0; k < first[i].surfaces.size(); ++k) {
      CHECK(first[i].surfaces[k].mean == second[i].surfaces[k].mean);
      CHECK(first[i].surfaces[k].normal == second[i].surfaces[k].normal);
    }
  }
}
