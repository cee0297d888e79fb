#pragma once

#include "tools/simulate/sensors/lidar_model.hpp"

#include <array>
#include <vector>

namespace nilio::tools::simulate {

/// Motion of the sensor over one packet: constant velocity, exact to a micrometre over a millisecond.
struct LidarModel::Motion {
  core::Duration start;
  core::SE3 T_world_lidar;
  core::Vector3 velocity;          ///< in world
  core::Vector3 angular_velocity;  ///< in the sensor's frame
  std::vector<NearbyCar> cars;
  /// Retroreflectors within range of their halos.
  std::vector<Retroreflector> retroreflectors;

  [[nodiscard]] core::SE3 pose(double offset_s) const {
    return {T_world_lidar.rotation * core::so3_exp(angular_velocity * offset_s),
            T_world_lidar.translation + velocity * offset_s};
  }
};

/// Shots of 16 lasers and their hits.
struct LidarModel::Shots {
  std::array<const LidarBeam*, kRayGroup> beams{};
  std::array<std::size_t, kRayGroup> lasers{};
  std::array<BeamAzimuth, kRayGroup> azimuths{};
  std::array<Eigen::Quaterniond, kRayGroup> R_world_lidar;
  std::array<core::Vector3, kRayGroup> directions;  ///< of the middle of the beam, in the sensor's frame
  /// Offset of the rays from the middle of the beam, clockwise: a beam is wider than high.
  double aside_rad = 0.0;
  RayGroup rays;
  std::array<RayHit, kRayGroup> hits{};

  void point(std::size_t i, const core::Vector3& direction) {
    directions[i] = direction;
    const core::Vector3 aside(-azimuths[i].sin, -azimuths[i].cos, 0.0);
    const core::Vector3 ray =
        aside_rad == 0.0 ? direction : core::Vector3((direction + aside_rad * aside).normalized());
    rays.direction[i] = (R_world_lidar[i] * ray).cast<float>();
  }
};

/// Surfaces in the footprints of 16 shots, if more than their middle.
struct LidarModel::Footprints {
  std::array<std::array<PartialHit, kFootprintRays>, kRayGroup> parts;
  std::array<std::size_t, kRayGroup> count{};
};

}  // namespace nilio::tools::simulate
