#include "nilio/core/units.hpp"

#include "tools/bench/sharpness/map_sharpness.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <unordered_set>

namespace nilio::tools::bench {

namespace {

constexpr double kMinRangeM = 5.0;
constexpr double kMaxRangeM = 50.0;
constexpr double kCellM = 0.1;

/// The same hash as the reference implementation has, so that the same points remain where two cells collide.
std::int64_t cell_hash(const Eigen::Vector3d& p, double cell_m) {
  const auto part = [&](int axis, std::int64_t prime) {
    return static_cast<std::int64_t>(std::floor(p[axis] / cell_m)) * prime;
  };
  return part(0, 73856093) ^ part(1, 19349663) ^ part(2, 83492791);
}

Eigen::Vector3d raised(const Eigen::Vector3d& p, double angle_rad) {
  const double horizontal = std::hypot(p.x(), p.y());
  const double turned = std::cos(angle_rad) * horizontal - std::sin(angle_rad) * p.z();
  const double factor = turned / horizontal;
  return {p.x() * factor, p.y() * factor, std::sin(angle_rad) * horizontal + std::cos(angle_rad) * p.z()};
}

}  // namespace

Cloud first_per_cell(const Cloud& points, double cell_m) {
  std::unordered_set<std::int64_t> seen;
  seen.reserve(points.size());
  Cloud result;
  for (const Eigen::Vector3d& p : points) {
    if (seen.insert(cell_hash(p, cell_m)).second) result.push_back(p);
  }
  return result;
}

Cloud prepare_scan(Cloud points, double elevation_correction_deg) {
  std::erase_if(points, [](const Eigen::Vector3d& p) {
    const double square = p.squaredNorm();
    return square <= kMinRangeM * kMinRangeM || square >= kMaxRangeM * kMaxRangeM;
  });
  if (elevation_correction_deg != 0.0) {
    for (Eigen::Vector3d& p : points) p = raised(p, elevation_correction_deg * kRadiansPerDegree);
  }
  return first_per_cell(points, kCellM);
}

ScanMotion mean_motion(std::span<const Eigen::Isometry3d> poses, std::size_t i) {
  constexpr std::size_t reach = 3;
  const std::size_t from = i > reach ? i - reach : 0;
  const std::size_t to = std::min(poses.size() - 1, i + reach);
  ScanMotion motion = ScanMotion::Zero();
  if (to == from) return motion;
  const Eigen::Isometry3d step = poses[from].inverse() * poses[to];
  const Eigen::Matrix3d R = step.linear();
  const Eigen::Vector3d sines =
      0.5 * Eigen::Vector3d(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1));
  const double sine = sines.norm();
  const Eigen::Vector3d rotation = sines * (sine > 1e-12 ? std::asin(std::min(sine, 1.0)) / sine : 1.0);
  const Eigen::Vector3d translation = step.translation();
  motion << translation - (0.5 * rotation).cross(translation), rotation;
  return motion / static_cast<double>(to - from);
}

Cloud compensate(Cloud points, const ScanMotion& motion) {
  for (Eigen::Vector3d& p : points) {
    const double time = -std::atan2(p.y(), p.x()) / (2.0 * std::numbers::pi);
    p += time * (motion.head<3>() + motion.tail<3>().cross(p));
  }
  return points;
}

}  // namespace nilio::tools::bench
