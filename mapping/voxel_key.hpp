#pragma once

#include <cmath>
#include <cstdint>
#include <optional>

#include <Eigen/Core>

namespace nilio::mapping {

/// Voxel of a grid that is bounded to 1024 voxels a side about its origin, 10 bits an axis.
using VoxelKey = std::uint32_t;

inline constexpr int kKeyBits = 10;
inline constexpr int kHalfGrid = 1 << (kKeyBits - 1);

/// Index of a voxel along each axis, from -512 to 511. Empty outside of the grid.
inline std::optional<VoxelKey> key_of(const Eigen::Vector3i& index) {
  const Eigen::Vector3i shifted = index.array() + kHalfGrid;
  if (shifted.minCoeff() < 0 || shifted.maxCoeff() >= 2 * kHalfGrid) return std::nullopt;
  // z is the most significant: neighbours in a horizontal plane have near keys.
  return static_cast<VoxelKey>(shifted.z()) << (2 * kKeyBits) |
         static_cast<VoxelKey>(shifted.y()) << kKeyBits | static_cast<VoxelKey>(shifted.x());
}

inline Eigen::Vector3i index_of(VoxelKey key) {
  constexpr VoxelKey mask = (1U << kKeyBits) - 1;
  return Eigen::Vector3i(static_cast<int>(key & mask), static_cast<int>(key >> kKeyBits & mask),
                         static_cast<int>(key >> (2 * kKeyBits) & mask))
             .array() -
         kHalfGrid;
}

/// Index of the voxel that contains a point.
inline Eigen::Vector3i index_at(const Eigen::Vector3f& point, float voxel_m) {
  return (point / voxel_m).array().floor().cast<int>();
}

inline Eigen::Vector3f centre_of(const Eigen::Vector3i& index, float voxel_m) {
  return (index.cast<float>().array() + 0.5F) * voxel_m;
}

}  // namespace nilio::mapping
