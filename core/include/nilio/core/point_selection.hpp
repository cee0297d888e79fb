#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/voxel_filter.hpp"
#include "nilio/core/voxel_map.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace nilio::core {

struct SelectionConfig {
  /// Points to choose at most.
  std::size_t target = 2000;
  /// Voxel of the candidates, metres: neighbours on one surface say the same thing twice.
  float voxel_size_m = 1.0F;
  double max_planarity = 0.1;
};

/// Chooses points so that every direction of motion is held by its share: candidates are sorted by the map
/// normal they will meet (ground near, ground far, four headings of vertical planes, every other plane, voxels
/// without a plane) and each group gives an equal number, small groups all they have. Order and choice depend on the data alone.
class PointSelector {
 public:
  explicit PointSelector(std::size_t capacity);

  /// Fills `selection` with indices into `points`, ascending. `positions` are the points as they are expected
  /// at the end of the scan, `T_map_moving` the expected pose. `filter` is used meanwhile.
  void select(const VoxelMap& map, VoxelFilter& filter, std::span<const Eigen::Vector3f> positions,
              const SE3& T_map_moving, const SelectionConfig& config, std::vector<std::uint32_t>& selection);

 private:
  static constexpr std::size_t kGroups = 8;

  void sort_candidates(const VoxelMap& map, std::span<const Eigen::Vector3f> positions,
                       const SE3& T_map_moving, double max_planarity);

  std::vector<std::uint32_t> candidates_;
  std::vector<std::uint32_t> groups_[kGroups];
};

}  // namespace nilio::core
