#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace nilio::mapping {

/// A point with its reflectivity, 0..255.
struct MapPoint {
  Eigen::Vector3f position = Eigen::Vector3f::Zero();
  float intensity = 0.0F;
};

/// Registered scan that enters the map.
struct Keyframe {
  core::Time stamp;
  core::SE3 T_odom_base;
  /// Covariance of the registration against the local map: position then rotation, in odom axes; m^2, rad^2.
  core::Matrix6 covariance = core::Matrix6::Zero();
  /// In base_link, metres.
  std::vector<MapPoint> points;
};

}  // namespace nilio::mapping
