#include "tools/inspect/lidar_mounting.hpp"

#include "nilio/core/units.hpp"

#include <algorithm>
#include <cstddef>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools::inspect;
using core::SE3;
using core::Vector3;

namespace {

SE3 mounting_of(double height_m, const Vector3& rpy_deg) {
  const Vector3 rpy = rpy_deg * kRadiansPerDegree;
  return {Eigen::AngleAxisd(rpy.z(), Vector3::UnitZ()) * Eigen::AngleAxisd(rpy.y(), Vector3::UnitY()) *
              Eigen::AngleAxisd(rpy.x(), Vector3::UnitX()),
          {0.0, 0.0, height_m}};
}

/// Scans every metre along a road of 6 m between pavements 15 cm higher and walls, with 2 cm of noise.
std::vector<MountingScan> drive(const SE3& T_base_lidar, double length_m, double turn_rad_m) {
  std::mt19937_64 random(7);
  std::normal_distribution<double> noise(0.0, 0.02);
  std::uniform_real_distribution<double> share(-1.0, 1.0);
  std::vector<MountingScan> scans;
  SE3 T_odom_base;
  const SE3 step{Eigen::Quaterniond(Eigen::AngleAxisd(turn_rad_m, Vector3::UnitZ())), {1.0, 0.0, 0.0}};
  for (double s = 0.0; s < length_m; s += 1.0) {
    MountingScan scan;
    scan.T_odom_lidar = T_odom_base * T_base_lidar;
    for (int i = 0; i < 1500; ++i) {
      const double y = 8.0 * share(random);
      double z = std::abs(y) > 3.0 ? 0.15 : 0.0;
      if (std::abs(y) > 7.0) z = 3.0 * std::abs(share(random));
      const Vector3 p(25.0 * share(random), y, z + noise(random));
      if (p.head<2>().norm() > 3.0) scan.points.push_back((T_base_lidar.inverse() * p).cast<float>());
    }
    scans.push_back(std::move(scan));
    T_odom_base = T_odom_base * step;
  }
  return scans;
}

}  // namespace

TEST_CASE("the mounting of a LiDAR is found from the ground and straight driving", "[lidar_mounting]") {
  struct Case {
    double height_m;
    Vector3 rpy_deg;
  };
  const std::vector<Case> cases{
      {1.9, {3.0, -4.0, 25.0}}, {0.6, {-8.0, 10.0, -90.0}}, {3.2, {0.0, 0.0, 179.0}}};
  for (const auto& [height_m, rpy_deg] : cases) {
    INFO(rpy_deg.transpose());
    const LidarMounting found = estimate_lidar_mounting(drive(mounting_of(height_m, rpy_deg), 40.0, 0.0));
    CHECK(found.is_yaw_observed());
    CHECK(found.straight_m >= 30.0);
    CHECK(found.ground_scans >= 30);
    CHECK(found.height_m == Approx(height_m).margin(0.01));
    for (int i = 0; i < 3; ++i) CHECK(found.rotation_rpy_deg[i] == Approx(rpy_deg[i]).margin(0.1));
  }
}

TEST_CASE("without straight driving the yaw is not observed and left at 0", "[lidar_mounting]") {
  const auto scans = drive(mounting_of(1.9, {3.0, -4.0, 0.0}), 40.0, 0.05);
  const LidarMounting found = estimate_lidar_mounting(scans);
  CHECK_FALSE(found.is_yaw_observed());
  CHECK(found.height_m == Approx(1.9).margin(0.02));
  CHECK(found.rotation_rpy_deg.x() == Approx(3.0).margin(0.2));
  CHECK(found.rotation_rpy_deg.y() == Approx(-4.0).margin(0.2));
  CHECK(found.rotation_rpy_deg.z() == Approx(0.0).margin(1e-9));
}

TEST_CASE("a stretch in reverse leaves the yaw, and as much reverse as forwards says nothing",
          "[lidar_mounting]") {
  const SE3 T_base_lidar = mounting_of(1.9, {3.0, -4.0, 25.0});
  const auto there_and_back = [&](std::size_t back_m) {
    auto scans = drive(T_base_lidar, 40.0, 0.0);
    for (std::size_t i = 0; i < back_m; ++i) scans.push_back(scans[38 - i]);
    return scans;
  };
  const LidarMounting short_reverse = estimate_lidar_mounting(there_and_back(16));
  CHECK(short_reverse.is_yaw_observed());
  CHECK(short_reverse.reversed_m >= 10.0);
  CHECK(short_reverse.rotation_rpy_deg.z() == Approx(25.0).margin(0.1));
  // Reverse first: the longer way is forwards.
  auto scans = there_and_back(16);
  std::rotate(scans.begin(), scans.end() - 16, scans.end());
  CHECK(estimate_lidar_mounting(scans).rotation_rpy_deg.z() == Approx(25.0).margin(0.1));
  const LidarMounting ambiguous = estimate_lidar_mounting(there_and_back(38));
  CHECK(ambiguous.is_direction_ambiguous());
  CHECK_FALSE(ambiguous.is_yaw_observed());
  CHECK(ambiguous.height_m == Approx(1.9).margin(0.02));
}

TEST_CASE("without ground there is no mounting", "[lidar_mounting]") {
  std::vector<MountingScan> scans(5);
  for (MountingScan& scan : scans) {
    for (int i = 0; i < 500; ++i)
      scan.points.emplace_back(5.0F, 0.01F * static_cast<float>(i), 0.02F * static_cast<float>(i % 50));
  }
  const LidarMounting found = estimate_lidar_mounting(scans);
  CHECK(found.ground_scans == 0);
  CHECK_FALSE(found.is_yaw_observed());
  CHECK(estimate_lidar_mounting({}).ground_scans == 0);
}
