#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace nilio::mapping {

/// Surface in one voxel, in the axes of its submap, metres.
struct Surface {
  Eigen::Vector3f mean = Eigen::Vector3f::Zero();
  /// Unit normal that points towards the sensor; of an irregular voxel the direction of its least spread.
  Eigen::Vector3f normal = Eigen::Vector3f::UnitZ();
  /// Standard deviation along the normal.
  float thickness_m = 0.0F;
  float intensity = 0.0F;  ///< mean, 0..255
  std::uint32_t points = 0;
  /// Index in Submap::keyframes of the last keyframe that has seen it.
  std::uint16_t keyframe = 0;
  /// True: a plane in a voxel of kPlaneVoxelMetres. False: irregular points in one of kIrregularVoxelMetres.
  bool is_plane = true;
};

inline constexpr float kPlaneVoxelMetres = 0.5F;
inline constexpr float kIrregularVoxelMetres = 1.0F;

/// Pose of a keyframe in its submap.
struct SubmapKeyframe {
  core::Time stamp;
  core::SE3 T_submap_base;
  /// See Keyframe::covariance; upper triangle by rows, float precision.
  std::array<float, 21> covariance{};
};

/// Frozen piece of the map: the surfaces that a stretch of the drive has seen. Its axes are those of odom
/// (aligned with gravity where odom is), its origin lies on the voxel grid of odom, so that neighbouring
/// submaps have the same voxels. A voxel that two neighbours have seen is stored in one of them.
struct Submap {
  std::uint32_t id = 0;
  core::SE3 T_odom_submap;
  std::vector<SubmapKeyframe> keyframes;
  std::vector<Surface> surfaces;
  /// Of the surfaces; equal vectors without any.
  Eigen::Vector3f minimum = Eigen::Vector3f::Zero();
  Eigen::Vector3f maximum = Eigen::Vector3f::Zero();
};

}  // namespace nilio::mapping
