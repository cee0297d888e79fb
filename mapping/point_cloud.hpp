#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "mapping/bytes.hpp"
#include "mapping/submap.hpp"

namespace nilio::mapping {

/// Surface of a map as a point in the map frame.
struct CloudPoint {
  core::Vector3 position = core::Vector3::Zero();
  Eigen::Vector3f normal = Eigen::Vector3f::UnitZ();
  float intensity = 0.0F;    ///< 0..255
  float thickness_m = 0.0F;  ///< standard deviation along the normal
  core::Time stamp;          ///< of the last keyframe that has seen it
};

/// One point for each surface, in their order. With a spacing, a plane is a grid of points that fills its
/// voxel, at about this distance from each other and from those of its neighbours.
std::vector<CloudPoint> points_of(const Submap& submap, const core::SE3& T_map_submap,
                                  double spacing_m = 0.0);

/// Header of a binary PLY with the properties x y z nx ny nz intensity (float), red green blue (uchar, grey
/// of the intensity) and gps_time (double, s). Of kPlyHeaderBytes for any number of points.
std::string ply_header(std::uint64_t points);
inline constexpr std::size_t kPlyHeaderBytes = 384;
inline constexpr std::size_t kPlyRowBytes = 7 * 4 + 3 + 8;
/// Appends a row of that file.
void put_ply_row(const CloudPoint& point, ByteWriter& out);
/// Intensity as a byte.
std::uint8_t grey_of(const CloudPoint& point);

}  // namespace nilio::mapping
