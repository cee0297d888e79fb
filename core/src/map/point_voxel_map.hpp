#pragma once

#include "nilio/core/se3.hpp"

#include "core/src/map/gaussian_voxel_map.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace nilio::core {

struct PointMapConfig {
  double voxel_size_m = 1.0;
  /// Voxels farther than this from the last pose are evicted.
  double radius_m = 100.0;
  /// Voxels the map can hold; all memory is allocated at construction.
  std::size_t capacity = 100000;
};

/// Map of points, a bounded and evenly spaced number per voxel, for metrics that need nearest neighbours. A
/// rolling grid refers to voxels of a preallocated slab; a full slab refuses voxels and counts them. One
/// writer; concurrent const access is safe while nobody writes.
class PointMap {
 public:
  static constexpr std::size_t kPointsPerVoxel = 20;

  struct Neighbour {
    Vector3 position;  ///< in the map frame
    double square_distance = 0.0;
  };

  explicit PointMap(const PointMapConfig& config);

  void clear();
  /// Inserts points in the map frame; a point closer to a stored one than the spacing is skipped.
  void insert(std::span<const Vector3> points);
  /// Visits a tenth of the slab and evicts voxels beyond the radius around `center`.
  void evict_far_from(const Vector3& center);

  /// The nearest stored points within `max_distance_m`, at most as far as one voxel, nearest first. Fills
  /// `neighbours` as far as there are any and returns how many.
  std::size_t find_nearest(const Vector3& position, double max_distance_m,
                           std::span<Neighbour> neighbours) const;

  [[nodiscard]] const PointMapConfig& config() const { return config_; }
  /// Minimum distance of stored points in a voxel, metres.
  [[nodiscard]] double spacing_m() const;
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  struct Voxel {
    VoxelIndex index = VoxelIndex::Zero();
    std::uint32_t count = 0;  ///< 0: free
    /// Relative to the voxel's lower corner.
    std::array<Eigen::Vector3f, kPointsPerVoxel> points;
  };

  [[nodiscard]] VoxelIndex index_of(const Vector3& position) const {
    return (position * inverse_size_).array().floor().cast<int>();
  }
  [[nodiscard]] std::size_t cell_of(const VoxelIndex& index) const;
  [[nodiscard]] const Voxel* find(const VoxelIndex& index) const;
  Voxel* find_or_create(const VoxelIndex& index);

  PointMapConfig config_;
  double inverse_size_ = 1.0;
  float square_spacing_ = 0.0F;
  std::uint32_t side_mask_ = 0;    ///< cells along x and y, less one
  std::uint32_t height_mask_ = 0;  ///< cells along z, less one
  std::uint32_t side_bits_ = 0;
  std::vector<std::uint32_t> cells_;  ///< index into the slab
  std::vector<Voxel> voxels_;
  std::vector<std::uint32_t> free_;
  std::size_t size_ = 0;
  std::size_t sweep_position_ = 0;
  std::uint64_t refused_ = 0;
};

}  // namespace nilio::core
