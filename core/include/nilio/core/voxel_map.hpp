#pragma once

#include "nilio/core/se3.hpp"

#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace nilio::core {

/// Integer coordinates of a voxel.
using VoxelIndex = Eigen::Vector3i;

/// What registration reads of a voxel: one cache line. Positions are relative to the voxel's lower corner, so
/// that single precision is enough anywhere.
struct alignas(64) VoxelSurface {
  Eigen::Vector3f mean = Eigen::Vector3f::Zero();
  /// Unit normal of the plane through the mean (smallest eigenvector).
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  /// Inverse of the regularised covariance, upper triangle: xx xy xz yy yz zz (1/m^2).
  float information[6] = {};
  /// Smallest eigenvalue over the middle one; above 1 where the points are too few or too much in line for a
  /// plane.
  float planarity = 2.0F;
  /// Smallest eigenvalue, m^2: the thickness of the plane.
  float thickness = 0.0F;
  /// Points behind the surface, 0 until there are enough for one.
  std::uint32_t count = 0;
};

struct VoxelMapConfig {
  double voxel_size_m = 1.0;
  /// Voxels farther than this from the last pose are evicted.
  double radius_m = 100.0;
  /// Voxels the map can hold; all memory is allocated at construction.
  std::size_t capacity = 100000;
  /// Points from which a voxel has a surface.
  std::uint32_t min_points = 6;
  /// Moments are halved when a voxel reaches this many points, so that it follows a changing world and never
  /// overflows.
  std::uint32_t max_points = 100;
  /// A voxel is no plane while the numbers of its points' beams lie within this range: points of one beam
  /// lie on its cone whatever they hit, so their plane turns with the sensor. 0 = not looked at.
  float min_beam_spread = 0.0F;
};

/// Incremental voxel map with a Gaussian and a plane per voxel, kept up to date on insertion and never
/// re-solved while registering. Bounded: open addressing over a preallocated slab; when full, new voxels are
/// refused and counted. Iteration and eviction follow the slab, never the hash, so results do not depend on
/// it. One writer; concurrent const access is safe while nobody writes.
class VoxelMap {
 public:
  explicit VoxelMap(const VoxelMapConfig& config);

  void clear();
  /// Inserts points given in the map frame. `beams` that saw them: one for each point,
  /// or none for a map that does not look at them.
  void insert(std::span<const Vector3> points, std::span<const float> beams = {});
  /// Looks at a tenth of the slab and drops what is farther than the radius from `center`: bounded work a
  /// scan.
  void evict_far_from(const Vector3& center);

  [[nodiscard]] VoxelIndex index_of(const Vector3& position) const {
    return (position * inverse_size_).array().floor().cast<int>();
  }
  [[nodiscard]] Vector3 corner_of(const VoxelIndex& index) const {
    return index.cast<double>() * config_.voxel_size_m;
  }
  /// The surface of a voxel, or nullptr while it has none.
  [[nodiscard]] const VoxelSurface* find(const VoxelIndex& index) const;

  [[nodiscard]] const VoxelMapConfig& config() const { return config_; }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  // What only insertion touches.
  struct Moments {
    std::uint64_t key = 0;
    Vector3 sum = Vector3::Zero();
    double products[6] = {};
    float min_beam = 0.0F;
    float max_beam = 0.0F;
    std::uint32_t count = 0;
    std::uint32_t refresh_at = 0;
    bool occupied = false;
  };
  struct Slot {
    std::uint64_t key = 0;
    std::uint32_t voxel = 0;
    bool occupied = false;
  };

  [[nodiscard]] bool seen_by_several_beams(const Moments& moments) const {
    return moments.max_beam - moments.min_beam >= config_.min_beam_spread;
  }
  [[nodiscard]] std::size_t home_slot(std::uint64_t key) const;
  [[nodiscard]] std::size_t find_slot(std::uint64_t key) const;
  std::uint32_t find_or_create(std::uint64_t key);
  void erase(std::uint32_t voxel);
  void add(std::uint32_t voxel, const Vector3& local, float beam);
  void refresh(std::uint32_t voxel);

  VoxelMapConfig config_;
  double inverse_size_ = 1.0;
  std::vector<VoxelSurface> surfaces_;
  std::vector<Moments> moments_;
  std::vector<Slot> slots_;
  std::vector<std::uint32_t> free_;
  std::size_t mask_ = 0;
  std::size_t size_ = 0;
  std::size_t sweep_position_ = 0;
  std::uint64_t refused_ = 0;
};

}  // namespace nilio::core
