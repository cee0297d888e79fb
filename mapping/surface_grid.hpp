#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <unordered_map>
#include <vector>

#include <Eigen/Core>

#include "mapping/submap.hpp"
#include "mapping/voxel_key.hpp"

namespace nilio::mapping {

/// Sums over the points of a voxel, relative to its centre.
struct VoxelSums {
  std::uint32_t points = 0;
  std::uint32_t keyframes = 0;
  std::uint16_t last_keyframe = 0;
  /// Whether the surface shall not be stored in this submap.
  bool is_elsewhere = false;
  float intensity = 0.0F;
  Eigen::Vector3f sum = Eigen::Vector3f::Zero();
  /// Towards the sensors that have seen it.
  Eigen::Vector3f towards_sensor = Eigen::Vector3f::Zero();
  /// xx xy xz yy yz zz.
  std::array<float, 6> squares{};

  /// Adds the sums of another voxel, whose centre lies at `offset` from this one's.
  void add(const VoxelSums& other, const Eigen::Vector3f& offset);
};

/// Grid of plane voxels that a submap is accumulated in. Bounded memory: new voxels beyond the capacity are
/// refused and counted. One thread.
class SurfaceGrid {
 public:
  explicit SurfaceGrid(std::size_t capacity) : capacity_(capacity) {}

  /// Adds a point of keyframe number `keyframe`, seen from `sensor`; both in the axes of the submap. Points
  /// outside of the grid are ignored.
  void add(const Eigen::Vector3f& point, float intensity, const Eigen::Vector3f& sensor,
           std::uint16_t keyframe);
  [[nodiscard]] VoxelSums* find(VoxelKey key);
  [[nodiscard]] std::size_t size() const { return voxels_.size(); }
  [[nodiscard]] std::uint64_t refused() const { return refused_; }
  [[nodiscard]] std::unordered_map<VoxelKey, VoxelSums>& voxels() { return voxels_; }

  /// Surfaces of the voxels that are not elsewhere, in order of their keys: planes, then the remaining points
  /// of several keyframes in irregular voxels.
  [[nodiscard]] std::vector<Surface> surfaces() const;

 private:
  std::size_t capacity_;
  std::uint64_t refused_ = 0;
  std::unordered_map<VoxelKey, VoxelSums> voxels_;
};

}  // namespace nilio::mapping
