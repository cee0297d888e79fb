#pragma once

#include "nilio/core/se3.hpp"

#include "core/src/map/gaussian_voxel_map.hpp"
#include "core/src/preprocessing/voxel_downsampling.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace nilio::core {

/// Samples at most `target` points evenly.
void sample_evenly(const std::vector<Eigen::Vector3f>& points, std::size_t target,
                   std::vector<Eigen::Vector3f>& output);

struct SelectionConfig {
  /// Maximum number of points.
  std::size_t target = 2000;
  /// Voxel of the candidates, metres: neighbours on one surface are redundant.
  float voxel_size_m = 1.0F;
  double max_planarity = 0.1;
};

/// Normal-space sampling: candidates are grouped by the map normal at their predicted position (near ground,
/// far ground, four headings of vertical planes, other planes, non-planar voxels); each group contributes an
/// equal number, small groups all they have. Depends on the data alone.
class NormalSpaceSampler {
 public:
  explicit NormalSpaceSampler(std::size_t capacity);

  /// Fills `selection` with ascending indices. `positions` are deskewed points, `T_map_moving` is the
  /// predicted pose; `filter` serves as scratch.
  void select(const VoxelMap& map, VoxelDownsampler& filter, std::span<const Eigen::Vector3f> positions,
              const SE3& T_map_moving, const SelectionConfig& config, std::vector<std::uint32_t>& selection);

 private:
  static constexpr std::size_t kGroups = 8;

  void sort_candidates(const VoxelMap& map, std::span<const Eigen::Vector3f> positions,
                       const SE3& T_map_moving, double max_planarity);

  std::vector<std::uint32_t> candidates_;
  std::vector<std::uint32_t> groups_[kGroups];
};

}  // namespace nilio::core
