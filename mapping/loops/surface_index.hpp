#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "mapping/submap.hpp"
#include "mapping/voxel_key.hpp"

namespace nilio::mapping {

/// Surfaces by voxel, for searches within the size of a voxel.
class SurfaceIndex {
 public:
  SurfaceIndex(std::span<const Surface> surfaces, float voxel_m) : voxel_m_(voxel_m) {
    std::vector<std::pair<VoxelKey, std::uint32_t>> rows;
    for (std::uint32_t i = 0; i < surfaces.size(); ++i) {
      if (const auto key = key_of(index_at(surfaces[i].mean, voxel_m))) rows.emplace_back(*key, i);
    }
    std::sort(rows.begin(), rows.end());
    while (table_.size() < 2 * rows.size()) table_.resize(2 * table_.size());
    for (std::uint32_t i = 0; i < rows.size(); ++i) {
      surfaces_.push_back(surfaces[rows[i].second]);
      Voxel& voxel = table_[slot_of(rows[i].first)];
      if (voxel.begin == voxel.end) {
        voxel = {rows[i].first, i, i};
        ++voxels_;
      }
      ++voxel.end;
    }
  }

  [[nodiscard]] bool has_voxel(const Eigen::Vector3i& index) const {
    const auto key = key_of(index);
    return key && find(*key) != nullptr;
  }
  [[nodiscard]] std::size_t voxels() const { return voxels_; }

  /// Nearest surface of the same kind with a similar normal; null if there is none within the voxel size.
  [[nodiscard]] const Surface* nearest(const Eigen::Vector3f& mean, const Eigen::Vector3f& normal,
                                       bool is_plane) const {
    return nearest_of(mean, [&](const Surface& surface) {
      return surface.is_plane == is_plane && (!is_plane || surface.normal.dot(normal) >= kMinNormalCosine);
    });
  }

  /// Nearest plane to a point whose normal is not known; null if there is none within the voxel size.
  [[nodiscard]] const Surface* nearest_plane(const Eigen::Vector3f& point) const {
    return nearest_of(point, [](const Surface& surface) { return surface.is_plane; });
  }

 private:
  static constexpr float kMinNormalCosine = 0.8F;

  /// Range in surfaces_; an empty one is a free slot.
  struct Voxel {
    VoxelKey key = 0;
    std::uint32_t begin = 0;
    std::uint32_t end = 0;
  };

  template <class IsWanted>
  [[nodiscard]] const Surface* nearest_of(const Eigen::Vector3f& point, const IsWanted& is_wanted) const {
    // The middle first, then by distance: most of the others are farther than what is found.
    static constexpr std::array<int, 27> kOrder{13, 4,  10, 12, 14, 16, 22, 1, 3, 5,  7,  9,  11, 15,
                                                17, 19, 21, 23, 25, 0,  2,  6, 8, 18, 20, 24, 26};
    const Surface* best = nullptr;
    float best_square = voxel_m_ * voxel_m_;
    const Eigen::Vector3i centre = index_at(point, voxel_m_);
    const Eigen::Vector3f inside = point - voxel_m_ * centre.cast<float>();
    const Eigen::Array3f below = inside.array().square();
    const Eigen::Array3f above = (voxel_m_ - inside.array()).square();
    for (const int i : kOrder) {
      const Eigen::Vector3i step(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1);
      float gap_square = 0.0F;
      for (int axis = 0; axis < 3; ++axis)
        gap_square += step[axis] == 0 ? 0.0F : step[axis] < 0 ? below[axis] : above[axis];
      if (gap_square >= best_square) continue;
      const auto key = key_of(centre + step);
      const Voxel* const voxel = key ? find(*key) : nullptr;
      if (voxel == nullptr) continue;
      for (std::uint32_t k = voxel->begin; k < voxel->end; ++k) {
        const float square = (surfaces_[k].mean - point).squaredNorm();
        if (square >= best_square || !is_wanted(surfaces_[k])) continue;
        best_square = square;
        best = &surfaces_[k];
      }
    }
    return best;
  }

  /// Slot of the voxel, or the free one where it would be (linear probing).
  [[nodiscard]] std::size_t slot_of(VoxelKey key) const {
    const std::size_t mask = table_.size() - 1;
    std::size_t slot = (key * std::uint64_t{0x9E3779B97F4A7C15U} >> 32U) & mask;
    while (table_[slot].begin != table_[slot].end && table_[slot].key != key) slot = (slot + 1) & mask;
    return slot;
  }
  [[nodiscard]] const Voxel* find(VoxelKey key) const {
    const Voxel& voxel = table_[slot_of(key)];
    return voxel.begin != voxel.end ? &voxel : nullptr;
  }

  float voxel_m_;
  std::vector<Surface> surfaces_;  ///< sorted by voxel
  std::vector<Voxel> table_ = std::vector<Voxel>(64);
  std::size_t voxels_ = 0;
};

}  // namespace nilio::mapping
