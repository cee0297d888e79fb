#include "core/src/map/gaussian_voxel_map.hpp"

#include "core/src/preprocessing/scan_filter.hpp"

#include <cmath>
#include <limits>
#include <map>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;

namespace {

std::vector<Vector3> points_on_plane(const Vector3& center, const Vector3& normal, double thickness,
                                     int count) {
  std::mt19937_64 generator(3);
  std::uniform_real_distribution<double> uniform(-0.4, 0.4);
  std::normal_distribution<double> noise(0.0, thickness);
  const Vector3 u = normal.unitOrthogonal();
  const Vector3 v = normal.cross(u);
  std::vector<Vector3> points;
  for (int i = 0; i < count; ++i)
    points.push_back(center + uniform(generator) * u + uniform(generator) * v + noise(generator) * normal);
  return points;
}

}  // namespace

TEST_CASE("a voxel estimates the plane of its points", "[gaussian_voxel_map]") {
  VoxelMap map({1.0, 100.0, 1000, 6, 100});
  const Vector3 normal = Vector3(0.1, -0.2, 1.0).normalized();
  const Vector3 center(1000.5, -2000.5, 3.5);
  map.insert(points_on_plane(center, normal, 0.01, 90));
  const GaussianVoxel* surface = map.find(map.index_of(center));
  REQUIRE(surface != nullptr);
  CHECK(std::abs(surface->normal.cast<double>().dot(normal)) > 0.999);
  CHECK((map.corner_of(map.index_of(center)) + surface->mean.cast<double>() - center).norm() < 0.1);
  CHECK(std::sqrt(surface->thickness) == Approx(0.01).epsilon(0.3));
  CHECK(surface->planarity < 0.01F);
}

TEST_CASE("a voxel with too few points has no Gaussian", "[gaussian_voxel_map]") {
  VoxelMap map({1.0, 100.0, 1000, 6, 100});
  const Vector3 center(0.5, 0.5, 0.5);
  map.insert(points_on_plane(center, Vector3::UnitZ(), 0.01, 5));
  CHECK(map.find(map.index_of(center)) == nullptr);
  CHECK(map.size() == 1);
}

TEST_CASE("the points of one beam are no plane until another beam hits the voxel", "[gaussian_voxel_map]") {
  VoxelMapConfig config{1.0, 100.0, 1000, 6, 100};
  config.min_beam_spread = 0.02F;
  VoxelMap map(config);
  const Vector3 center(0.5, 0.5, 0.5);
  const std::vector<Vector3> points = points_on_plane(center, Vector3::UnitZ(), 0.002, 61);
  std::vector<float> elevations(60, 0.1F);
  for (std::size_t i = 0; i < elevations.size(); i += 2) elevations[i] += 0.005F;
  map.insert(std::span(points).first(60), elevations);
  const GaussianVoxel* surface = map.find(map.index_of(center));
  REQUIRE(surface != nullptr);
  CHECK(surface->planarity > 1.0F);
  // Its mean still serves the coarse registration.
  CHECK(surface->information[5] > surface->information[0]);

  const std::vector<float> next_beam{0.135F};
  map.insert(std::span(points).last(1), next_beam);
  CHECK(map.find(map.index_of(center))->planarity < 0.01F);
}

TEST_CASE("a full map refuses new voxels, counts them and keeps the old ones", "[gaussian_voxel_map]") {
  VoxelMap map({1.0, 1000.0, 10, 1, 100});
  std::vector<Vector3> points;
  for (int i = 0; i < 25; ++i) points.emplace_back(i + 0.5, 0.5, 0.5);
  map.insert(points);
  CHECK(map.size() == 10);
  CHECK(map.refused() == 15);
  CHECK(map.find(map.index_of(points[0])) != nullptr);
  CHECK(map.find(map.index_of(points[20])) == nullptr);
}

TEST_CASE("eviction drops far voxels, keeps near ones, and visits a bounded share of the slab",
          "[gaussian_voxel_map]") {
  VoxelMap map({1.0, 50.0, 4096, 1, 100});
  std::mt19937_64 generator(11);
  std::uniform_real_distribution<double> uniform(-200.0, 200.0);
  std::map<std::tuple<int, int, int>, Vector3> truth;
  std::vector<Vector3> points;
  for (int i = 0; i < 3000; ++i) {
    points.emplace_back(uniform(generator), uniform(generator), uniform(generator) / 20.0);
    const VoxelIndex index = map.index_of(points.back());
    truth[{index.x(), index.y(), index.z()}] = points.back();
  }
  map.insert(points);
  REQUIRE(map.size() == truth.size());
  const std::size_t before = map.size();
  map.evict_far_from(Vector3::Zero());
  CHECK(before - map.size() <= 410);
  for (int i = 0; i < 10; ++i) map.evict_far_from(Vector3::Zero());
  std::size_t kept = 0;
  for (const auto& [key, point] : truth) {
    const VoxelIndex index = map.index_of(point);
    const bool near = map.corner_of(index).norm() <= 50.0;
    kept += near ? 1 : 0;
    CHECK((map.find(index) != nullptr) == near);
  }
  CHECK(map.size() == kept);
}

TEST_CASE("a voxel with endless insertions follows a changing world, and its count stays bounded",
          "[gaussian_voxel_map]") {
  VoxelMap map({1.0, 100.0, 100, 6, 100});
  const Vector3 low(0.5, 0.5, 0.2);
  const Vector3 high(0.5, 0.5, 0.8);
  for (int i = 0; i < 200; ++i) map.insert(points_on_plane(low, Vector3::UnitZ(), 0.001, 50));
  for (int i = 0; i < 20; ++i) map.insert(points_on_plane(high, Vector3::UnitZ(), 0.001, 50));
  const GaussianVoxel* surface = map.find(map.index_of(low));
  REQUIRE(surface != nullptr);
  CHECK(surface->count <= 100);
  CHECK(surface->mean.z() == Approx(0.8).margin(0.01));
}

TEST_CASE("the downsampler keeps the first point of each voxel and starts empty in the next pass",
          "[gaussian_voxel_map]") {
  VoxelDownsampler filter(100);
  for (int pass = 0; pass < 3; ++pass) {
    filter.begin(0.5F);
    CHECK(filter.insert({0.1F, 0.1F, 0.1F}));
    CHECK_FALSE(filter.insert({0.2F, 0.4F, 0.3F}));
    CHECK(filter.insert({-0.1F, 0.1F, 0.1F}));
    CHECK(filter.insert({0.6F, 0.1F, 0.1F}));
  }
}

TEST_CASE("a full downsampler refuses points instead of probing for ever", "[gaussian_voxel_map]") {
  VoxelDownsampler filter(8);
  filter.begin(1.0F);
  int kept = 0;
  for (int i = 0; i < 100; ++i) kept += filter.insert({static_cast<float>(i) + 0.5F, 0.0F, 0.0F}) ? 1 : 0;
  CHECK(kept == 8);
}

TEST_CASE(
    "filtering leaves out points that are too near, too far or not finite, and moves the rest to base_link",
    "[gaussian_voxel_map]") {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinite = std::numeric_limits<float>::infinity();
  Scan scan;
  scan.end = Time{100'000'000};
  const auto add = [&scan](float x, float y, float z, std::int32_t time) {
    Point point;
    point.x = x;
    point.y = y;
    point.z = z;
    point.time_offset_ns = time;
    scan.points.push_back(point);
  };
  add(10.0F, 0.0F, 0.0F, 25'000'000);
  add(0.5F, 0.0F, 0.0F, 0);
  add(500.0F, 0.0F, 0.0F, 0);
  add(nan, 0.0F, 0.0F, 0);
  add(0.0F, infinite, 0.0F, 0);
  SE3 T_base_lidar;
  T_base_lidar.rotation = Eigen::Quaterniond(Eigen::AngleAxisd(M_PI / 2.0, Vector3::UnitZ()));
  T_base_lidar.translation = Vector3(0.0, 0.0, 1.7);
  VoxelDownsampler filter(100);
  std::vector<SweepPoint> output;
  filter_scan(scan, {1.0F, 100.0F, 0.5F, 0.0F}, T_base_lidar, {}, filter, output);
  REQUIRE(output.size() == 1);
  CHECK((output[0].position - Eigen::Vector3f(0.0F, 10.0F, 1.7F)).norm() < 1e-5F);
  CHECK(output[0].time_s == Approx(-0.075F));
}

TEST_CASE("the elevation correction raises a beam by its angle and keeps its range and heading",
          "[gaussian_voxel_map]") {
  Scan scan;
  Point point;
  point.x = 3.0F;
  point.y = 4.0F;
  point.z = -1.0F;
  scan.points.push_back(point);
  VoxelDownsampler filter(100);
  std::vector<SweepPoint> output;
  const float angle = 0.01F;
  filter_scan(scan, {1.0F, 100.0F, 0.5F, angle}, {}, {}, filter, output);
  REQUIRE(output.size() == 1);
  const Eigen::Vector3f& p = output[0].position;
  CHECK(p.norm() == Approx(std::sqrt(26.0F)));
  CHECK(std::atan2(p.y(), p.x()) == Approx(std::atan2(4.0F, 3.0F)));
  CHECK(std::atan2(p.z(), p.head<2>().norm()) == Approx(std::atan2(-1.0F, 5.0F) + angle));
}
