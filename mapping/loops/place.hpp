#pragma once

#include "nilio/core/se3.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "mapping/submap.hpp"

namespace nilio::mapping {

/// Corner of a density image with a binary descriptor that does not depend on the heading.
struct PlaceFeature {
  Eigen::Vector2f position = Eigen::Vector2f::Zero();  ///< in the axes of the place, metres
  std::array<std::uint64_t, 4> bits{};
};

/// Surroundings of a submap: its surfaces and those of its neighbours, because a voxel that several submaps
/// have seen is stored in one of them. Axes of odom, origin at the middle keyframe of the submap.
struct Place {
  std::uint32_t id = 0;  ///< of the submap
  core::SE3 T_odom_place;
  std::vector<Surface> surfaces;
  /// For each surface the index in `path` of the last keyframe that has seen it.
  std::vector<std::uint32_t> viewers;
  /// Poses of all keyframes in the place, in order of time.
  std::vector<core::SE3> path;
  std::vector<PlaceFeature> features;
};

/// Whether a surface tells places apart: near-horizontal planes, ground and ceilings, are everywhere.
bool is_structure(const Surface& surface);

/// T_submap_place of a submap: its middle keyframe's position; no rotation.
core::SE3 place_origin(const Submap& submap);

/// The place of `submaps[middle]`; the others are its neighbours, in order.
Place make_place(std::span<const Submap* const> submaps, std::size_t middle);

/// Alignment of two places in the horizontal plane.
struct PlanarAlignment {
  /// Rotation about z and horizontal translation.
  core::SE3 T_reference_moving;
  std::uint32_t inliers = 0;  ///< matches that agree
};

/// Alignments that matched features agree on: the best one, then others at other places, at most `count`.
/// Every pair of matches is tried, so that the result does not depend on chance.
std::vector<PlanarAlignment> align_features(std::span<const PlaceFeature> reference,
                                            std::span<const PlaceFeature> moving, std::size_t count);

/// Whether two alignments put the moving place at clearly different places.
bool is_elsewhere(const core::SE3& a, const core::SE3& b);

}  // namespace nilio::mapping
