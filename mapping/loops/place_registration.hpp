#pragma once

#include <cstddef>
#include <unordered_set>

#include "mapping/loops/place.hpp"
#include "mapping/loops/surface_index.hpp"
#include "mapping/voxel_key.hpp"

namespace nilio::mapping {

/// Relative pose of two places from their surfaces, with what speaks for and against it. Structure: all
/// surfaces but near-horizontal planes, which are alike everywhere.
struct PlaceAlignment {
  core::SE3 T_reference_moving;
  /// Information of an error on the right, in axes of the moving place: translation, then rotation.
  core::Matrix6 information = core::Matrix6::Zero();
  /// Voxels of 1 m that both have, as a share of the smaller set.
  double overlap = 0.0;
  /// Structure of the moving place near both paths, and the share of it that lies on surfaces of the
  /// reference.
  std::uint32_t compared = 0;
  double support = 0.0;
  /// The same, the larger of both directions: structure that one place has not seen does not count.
  double larger_support = 0.0;
  /// Share of the compared structure of one place that lies where the other one has seen free space; the
  /// larger of both directions.
  double contradiction = 0.0;
};

inline constexpr std::size_t kRegisteredSurfaces = 4000;

/// Whether a point lies within 25 m of a path.
[[nodiscard]] bool is_near(const std::vector<core::SE3>& path, const Eigen::Vector3f& point);

/// A place with what every comparison with another one needs of it.
class ComparablePlace {
 public:
  /// Refers to the place.
  explicit ComparablePlace(const Place& place);

  [[nodiscard]] const Place& place() const { return place_; }
  /// Surfaces by voxels for correspondences, and by voxels of 1 m.
  [[nodiscard]] const SurfaceIndex& surfaces() const { return surfaces_; }
  [[nodiscard]] const SurfaceIndex& voxels() const { return voxels_; }
  /// Voxels of 1 m that rays have crossed and that hold no surface, nor do their neighbours.
  [[nodiscard]] bool is_free(VoxelKey voxel) const { return free_.count(voxel) > 0; }
  /// Support of the place by itself: the share of structure that one half of its keyframes has seen and that
  /// lies on surfaces seen by the other half. A scale for PlaceAlignment::support.
  [[nodiscard]] double self_support() const { return self_support_; }

 private:
  const Place& place_;
  SurfaceIndex surfaces_;
  SurfaceIndex voxels_;
  std::unordered_set<VoxelKey> free_;
  double self_support_;
};

/// Registers `moving` against `reference` from a guess that is right to about 2 m and 5 degrees: planes to
/// planes, irregular surfaces to irregular surfaces, wide to narrow. About `surfaces` of the moving ones
/// enter, and, where these are fewer, as small a part of the reference as long as the search is wide.
PlaceAlignment align_places(const ComparablePlace& reference, const ComparablePlace& moving,
                            const core::SE3& guess, std::size_t surfaces = kRegisteredSurfaces);

/// How much better the alignment fits than others at other places within 40 m: correlation of the
/// structure's voxels at the best other shift over that at the alignment, 0 to 1 and above.
double ambiguity(const Place& reference, const Place& moving, const core::SE3& T_reference_moving);

}  // namespace nilio::mapping
