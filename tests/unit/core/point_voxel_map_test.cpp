#include "core/src/map/point_voxel_map.hpp"

#include <algorithm>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;

namespace {

std::vector<Vector3> random_points(std::size_t count, double half_width, std::uint64_t seed) {
  std::mt19937_64 generator(seed);
  std::uniform_real_distribution<double> uniform(-half_width, half_width);
  std::vector<Vector3> points;
  for (std::size_t i = 0; i < count; ++i)
    points.emplace_back(uniform(generator), uniform(generator), uniform(generator));
  return points;
}

}  // namespace

TEST_CASE("the nearest points equal those of an exhaustive search", "[point_voxel_map]") {
  // Few enough that none is left out as too near to another or one too many.
  const std::vector<Vector3> points = random_points(60, 2.0, 1);
  PointMap map({1.0, 50.0, 1000});
  std::vector<Vector3> stored;
  for (const Vector3& point : points) {
    const bool crowded =
        std::any_of(stored.begin(), stored.end(), [&](const Vector3& p) { return (p - point).norm() < 0.3; });
    if (!crowded) stored.push_back(point);
  }
  map.insert(stored);
  std::size_t compared = 0;
  for (const Vector3& query : random_points(500, 2.5, 2)) {
    std::vector<double> distances;
    for (const Vector3& point : stored) distances.push_back((point - query).norm());
    std::sort(distances.begin(), distances.end());
    const auto wanted = static_cast<std::size_t>(
        std::count_if(distances.begin(), distances.begin() + 2, [](double d) { return d < 0.9; }));
    std::array<PointMap::Neighbour, 2> found;
    REQUIRE(map.find_nearest(query, 0.9, found) == wanted);
    for (std::size_t i = 0; i < wanted; ++i) {
      CHECK((found[i].position - query).norm() == Approx(distances[i]).margin(1e-6));
      ++compared;
    }
  }
  CHECK(compared > 300);
}

TEST_CASE("a voxel keeps a bounded number of points, evenly spaced", "[point_voxel_map]") {
  PointMap map({1.0, 50.0, 1000});
  std::vector<Vector3> points = random_points(20000, 0.5, 3);
  for (Vector3& point : points) point.array() += 0.5;
  map.insert(points);
  CHECK(map.size() == 1);
  // All stored points, queried from everywhere.
  std::vector<Vector3> stored;
  for (const Vector3& query : points) {
    std::array<PointMap::Neighbour, 1> nearest;
    REQUIRE(map.find_nearest(query, 1.0, nearest) == 1);
    const Vector3& found = nearest[0].position;
    if (std::none_of(stored.begin(), stored.end(), [&](const Vector3& p) { return p == found; }))
      stored.push_back(found);
  }
  CHECK(stored.size() == PointMap::kPointsPerVoxel);
  for (std::size_t i = 0; i < stored.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) CHECK((stored[i] - stored[k]).norm() > 0.22);
  }
}

TEST_CASE("a full point map refuses voxels and counts them", "[point_voxel_map]") {
  PointMap map({1.0, 50.0, 2});
  map.insert(std::vector<Vector3>{{0.5, 0.5, 0.5}, {1.5, 0.5, 0.5}, {2.5, 0.5, 0.5}, {1.9, 0.5, 0.5}});
  CHECK(map.size() == 2);
  CHECK(map.refused() == 1);
}

TEST_CASE("points behind the vehicle are evicted, and their cells are used again", "[point_voxel_map]") {
  PointMap map({1.0, 20.0, 500});
  std::array<PointMap::Neighbour, 1> nearest;
  // Once around the rolling grid and more: 64 cells along each side.
  for (int x = 0; x < 300; ++x) {
    const Vector3 here(x + 0.5, 0.5, -3.5);
    map.insert(std::vector<Vector3>{here});
    map.evict_far_from(here);
    REQUIRE(map.find_nearest(here, 0.5, nearest) == 1);
    CHECK(nearest[0].position.x() == Approx(here.x()));
  }
  CHECK(map.refused() == 0);
  CHECK(map.size() <= 20 + 10 + 2);
  CHECK(map.find_nearest({0.5, 0.5, -3.5}, 0.5, nearest) == 0);
}
