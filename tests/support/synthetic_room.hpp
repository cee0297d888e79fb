#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"

#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>
#include <optional>
#include <random>
#include <vector>

namespace nilio::tests {

/// A hall with pillars: exact surfaces that rays can be cast against without a library.
struct Room {
  core::Vector3 low{-30.0, -20.0, -1.8};
  core::Vector3 high{120.0, 25.0, 12.0};
  struct Pillar {
    double x;
    double y;
    double half_width;
  };
  std::vector<Pillar> pillars;

  static Room with_pillars() {
    Room room;
    for (int i = 0; i < 9; ++i) {
      room.pillars.push_back({-20.0 + 15.0 * i, 8.0 + (i % 3), 0.8});
      room.pillars.push_back({-14.0 + 15.0 * i, -9.0 - (i % 2), 1.2});
    }
    return room;
  }

  /// Distance along the unit direction to the first surface.
  [[nodiscard]] double cast(const core::Vector3& origin, const core::Vector3& direction) const {
    double nearest = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
      if (direction[axis] == 0.0) continue;
      const double wall = direction[axis] > 0.0 ? high[axis] : low[axis];
      nearest = std::min(nearest, (wall - origin[axis]) / direction[axis]);
    }
    for (const Pillar& pillar : pillars) {
      if (const auto hit = cast_pillar(pillar, origin, direction); hit && *hit < nearest) nearest = *hit;
    }
    return nearest;
  }

 private:
  [[nodiscard]] static std::optional<double> cast_pillar(const Pillar& pillar, const core::Vector3& origin,
                                                         const core::Vector3& direction) {
    double enter = 0.0;
    double leave = std::numeric_limits<double>::infinity();
    const double center[2] = {pillar.x, pillar.y};
    for (int axis = 0; axis < 2; ++axis) {
      const double a = (center[axis] - pillar.half_width - origin[axis]) / direction[axis];
      const double b = (center[axis] + pillar.half_width - origin[axis]) / direction[axis];
      enter = std::max(enter, std::min(a, b));
      leave = std::min(leave, std::max(a, b));
    }
    if (enter >= leave || enter <= 0.0) return std::nullopt;
    return enter;
  }
};

using PoseFunction = std::function<core::SE3(double time_s)>;

struct ScannerSettings {
  int rings = 16;
  int columns = 900;
  double lowest_deg = -15.0;
  double spacing_deg = 2.0;
  double period_s = 0.1;
  double noise_m = 0.01;
};

/// One revolution from `start_s`; every column is cast from the pose of its own time.
inline core::Scan scan_room(const Room& room, const PoseFunction& T_world_base, double start_s,
                            std::uint64_t sequence, const ScannerSettings& settings = {}) {
  std::mt19937_64 generator(sequence + 1);
  std::normal_distribution<double> noise(0.0, settings.noise_m);
  core::Scan scan;
  scan.sequence = sequence;
  scan.start = core::Time::from_seconds(start_s);
  scan.end = scan.start + core::Duration::from_seconds(settings.period_s);
  scan.beam_spacing_rad = static_cast<float>(settings.spacing_deg * std::numbers::pi / 180.0);
  scan.coverage_deg = 360.0F;
  for (int column = 0; column < settings.columns; ++column) {
    const double share = static_cast<double>(column) / settings.columns;
    const core::SE3 pose = T_world_base(start_s + share * settings.period_s);
    const double azimuth = std::numbers::pi - 2.0 * std::numbers::pi * share;
    for (int ring = 0; ring < settings.rings; ++ring) {
      const double elevation = (settings.lowest_deg + ring * settings.spacing_deg) * std::numbers::pi / 180.0;
      const core::Vector3 direction(std::cos(elevation) * std::cos(azimuth),
                                    std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
      const double range = room.cast(pose.translation, pose.rotation * direction) + noise(generator);
      core::Point point;
      point.x = static_cast<float>(range * direction.x());
      point.y = static_cast<float>(range * direction.y());
      point.z = static_cast<float>(range * direction.z());
      point.time_offset_ns = static_cast<std::int32_t>(share * settings.period_s * 1e9);
      point.ring = static_cast<std::uint16_t>(ring);
      scan.points.push_back(point);
    }
  }
  return scan;
}

/// Sample of an ideal IMU at base_link on the same motion.
inline core::ImuSample imu_sample(const PoseFunction& T_world_base, double time_s,
                                  const core::Vector3& gyro_bias) {
  constexpr double kStep = 1e-3;
  const core::SE3 before = T_world_base(time_s - kStep);
  const core::SE3 now = T_world_base(time_s);
  const core::SE3 after = T_world_base(time_s + kStep);
  const core::Vector3 rate =
      core::so3_log(before.rotation.conjugate() * after.rotation) / (2.0 * kStep) + gyro_bias;
  const core::Vector3 acceleration =
      (after.translation - 2.0 * now.translation + before.translation) / (kStep * kStep);
  const core::Vector3 force = now.rotation.conjugate() * (acceleration + core::Vector3(0.0, 0.0, 9.81));
  return {
      core::Time::from_seconds(time_s), {rate.x(), rate.y(), rate.z()}, {force.x(), force.y(), force.z()}};
}

}  // namespace nilio::tests
