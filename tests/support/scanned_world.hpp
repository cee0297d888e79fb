#pragma once

#include "nilio/core/portable_math.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "mapping/keyframe.hpp"

namespace nilio::tests {

using Eigen::Vector2d;

/// Vertical wall from the floor up.
struct Wall {
  Vector2d a;
  Vector2d b;
  double height_m = 6.0;
};

/// Walls on flat floors, which a sensor with 16 beams at 1.8 m sees.
struct ScannedWorld {
  std::vector<Wall> walls;
  double ceiling_m = 0.0;  ///< 0: none

  void add_box(const Vector2d& low, const Vector2d& high, double height_m) {
    const Vector2d right(high.x(), low.y());
    const Vector2d left(low.x(), high.y());
    for (const auto& [a, b] :
         {std::pair{low, right}, std::pair{right, high}, std::pair{high, left}, std::pair{left, low}})
      walls.push_back({a, b, height_m});
  }

  /// Points in axes of base_link at a position with a heading; the floor is at z = 0 there.
  [[nodiscard]] std::vector<mapping::MapPoint> scan(const Vector2d& position, double heading,
                                                    std::mt19937& random) const {
    constexpr double kHeight = 1.8;
    constexpr double kRange = 45.0;
    std::normal_distribution<double> noise(0.0, 0.015);
    std::uniform_real_distribution<double> phase(0.0, 1.0);
    std::vector<const Wall*> near;
    for (const Wall& wall : walls) {
      const Vector2d along = wall.b - wall.a;
      const double share = std::clamp((position - wall.a).dot(along) / along.squaredNorm(), 0.0, 1.0);
      if ((wall.a + share * along - position).norm() < kRange) near.push_back(&wall);
    }
    std::vector<mapping::MapPoint> points;
    const double start = phase(random);
    for (int i = 0; i < 240; ++i) {
      const double angle = (i + start) * 2.0 * 3.14159265358979 / 240.0;
      const Vector2d local(portable::cos(angle), portable::sin(angle));
      const Vector2d ray(portable::cos(angle + heading), portable::sin(angle + heading));
      std::vector<std::pair<double, double>> hits;  // distance, height
      for (const Wall* wall : near) {
        const Vector2d along = wall->b - wall->a;
        const Vector2d d = wall->a - position;
        const double cross = ray.x() * along.y() - ray.y() * along.x();
        if (std::abs(cross) < 1e-9) continue;
        const double distance = (d.x() * along.y() - d.y() * along.x()) / cross;
        const double share = (d.x() * ray.y() - d.y() * ray.x()) / cross;
        if (distance > 0.5 && share >= 0.0 && share <= 1.0) hits.emplace_back(distance, wall->height_m);
      }
      std::sort(hits.begin(), hits.end());
      for (int beam = 0; beam < 16; ++beam) {
        const double slope = std::tan((2.0 * beam - 15.0) * 3.14159265358979 / 180.0);
        double range = kRange;
        if (slope < 0.0) range = std::min(range, -kHeight / slope);
        if (slope > 0.0 && ceiling_m > 0.0) range = std::min(range, (ceiling_m - kHeight) / slope);
        for (const auto& [distance, height] : hits) {
          if (distance >= range) break;
          if (kHeight + slope * distance > height) continue;
          range = distance;
          break;
        }
        if (range >= kRange) continue;
        range += noise(random);
        points.push_back({{static_cast<float>(range * local.x()), static_cast<float>(range * local.y()),
                           static_cast<float>(kHeight + range * slope)},
                          50.0F});
      }
    }
    return points;
  }
};

/// Corner points of a path; the vehicle turns on the spot in steps.
struct PathPoint {
  Vector2d position;
  double height_m = 0.0;  ///< of the floor
};

/// Drift of the odometry of a drive.
struct Drift {
  double heading_rad_per_m = 0.0;
  double scale = 1.0;
  double height_per_m = 0.0;
};

struct ScannedDrive {
  std::vector<mapping::Keyframe> keyframes;  ///< poses of the odometry
  std::vector<core::SE3> truth;
};

/// Drives along the path with a keyframe each metre.
inline ScannedDrive drive(const ScannedWorld& world, const std::vector<PathPoint>& path, const Drift& drift,
                          std::uint32_t seed) {
  std::mt19937 random(seed);
  ScannedDrive result;
  core::SE3 odometry;
  core::SE3 before;
  const auto visit = [&](const Vector2d& p, double height, double heading) {
    core::SE3 T;
    T.translation = {p.x(), p.y(), height};
    T.rotation = core::so3_exp({0.0, 0.0, heading});
    if (result.truth.empty()) {
      odometry = T;
    } else {
      core::SE3 step = before.inverse() * T;
      const double length = step.translation.norm();
      step.translation *= drift.scale;
      step.translation.z() += drift.height_per_m * length;
      step.rotation = core::so3_exp({0.0, 0.0, drift.heading_rad_per_m * length}) * step.rotation;
      odometry = odometry * step;
    }
    before = T;
    mapping::Keyframe keyframe;
    keyframe.stamp = {1'000'000'000'000LL + static_cast<std::int64_t>(result.truth.size()) * 100'000'000LL};
    keyframe.T_odom_base = odometry;
    keyframe.covariance = 1e-4 * core::Matrix6::Identity();
    keyframe.points = world.scan(p, heading, random);
    result.keyframes.push_back(std::move(keyframe));
    result.truth.push_back(T);
  };
  double heading = 0.0;
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    const Vector2d along = path[i + 1].position - path[i].position;
    const double wanted = portable::atan2(along.y(), along.x());
    double turn = wanted - heading;
    while (turn > 3.1416) turn -= 2.0 * 3.14159265358979;
    while (turn < -3.1416) turn += 2.0 * 3.14159265358979;
    for (int k = 1; i > 0 && k < 5; ++k) visit(path[i].position, path[i].height_m, heading + turn * k / 5.0);
    heading = wanted;
    const int steps = static_cast<int>(along.norm());
    for (int k = 0; k < steps; ++k) {
      const double share = static_cast<double>(k) / steps;
      visit(path[i].position + share * along,
            path[i].height_m + share * (path[i + 1].height_m - path[i].height_m), heading);
    }
  }
  return result;
}

/// Boxes of random sizes on both sides of a road along x or y.
inline void line_road(ScannedWorld& world, const Vector2d& from, const Vector2d& to, std::mt19937& random) {
  std::uniform_real_distribution<double> share(0.0, 1.0);
  const Vector2d along = (to - from).normalized();
  const Vector2d left(-along.y(), along.x());
  for (const double side : {-1.0, 1.0}) {
    for (double s = 10.0; s < (to - from).norm() - 14.0; s += 5.0 + 8.0 * share(random)) {
      const double length = 3.0 + 9.0 * share(random);
      const double setback = 6.0 + 7.0 * share(random);
      const Vector2d a = from + s * along + side * setback * left;
      const Vector2d b = a + length * along + side * (2.0 + 6.0 * share(random)) * left;
      world.add_box(a.cwiseMin(b), a.cwiseMax(b), 1.0 + 7.0 * share(random));
      s += length;
    }
  }
}

/// A block of streets, 120 m by 80 m.
inline ScannedWorld block(std::uint32_t seed) {
  std::mt19937 random(seed);
  ScannedWorld world;
  const std::array<Vector2d, 4> corners{Vector2d{0, 0}, {120, 0}, {120, 80}, {0, 80}};
  for (std::size_t i = 0; i < 4; ++i) line_road(world, corners[i], corners[(i + 1) % 4], random);
  return world;
}

}  // namespace nilio::tests
