#pragma once

#include "nilio/core/se3.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace nilio::core {

/// Integer coordinates of a voxel.
using VoxelIndex = Eigen::Vector3i;

/// Registration data of a voxel: one cache line. Positions are relative to the lower corner, so that single
/// precision suffices anywhere.
struct alignas(64) GaussianVoxel {
  Eigen::Vector3f mean = Eigen::Vector3f::Zero();
  /// Unit normal of the plane through the mean (smallest eigenvector).
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  /// Inverse of the regularised covariance, upper triangle: xx xy xz yy yz zz (1/m^2).
  float information[6] = {};
  /// Smallest eigenvalue over the middle one; above 1 without a shape.
  float planarity = 2.0F;
  /// Smallest eigenvalue, m^2: the thickness of the plane.
  float thickness = 0.0F;
  /// Number of points, 0 until there are enough for a Gaussian.
  std::uint16_t count = 0;
  /// Number of scans that contributed points: static surfaces are seen again and again.
  std::uint16_t scans = 0;
  /// Half of the voxel's key that the hash table omits; private to the map.
  std::uint32_t key_high = 0;

  /// Whether the points spread across a line and come from several beams. Otherwise their shape turns with
  /// the sensor and carries no information.
  [[nodiscard]] bool has_shape() const { return planarity <= 1.0F; }
};

struct VoxelMapConfig {
  double voxel_size_m = 1.0;
  /// Voxels farther than this from the last pose are evicted.
  double radius_m = 100.0;
  /// Voxels the map can hold; all memory is allocated at construction.
  std::size_t capacity = 100000;
  /// Minimum number of points for a Gaussian.
  std::uint32_t min_points = 6;
  /// Moments are halved when a voxel reaches this many points, so that it follows a changing world and never
  /// overflows.
  std::uint32_t max_points = 100;
  /// Minimum range of beam numbers in a voxel: points of one beam lie on its cone whatever they hit. 0 = not
  /// checked.
  float min_beam_spread = 0.0F;
};

/// Incremental voxel map with a Gaussian and a plane per voxel, kept up to date on insertion and never
/// re-solved while registering. Bounded: open addressing over a preallocated slab; when full, new voxels are
/// refused and counted. Iteration and eviction follow the slab, never the hash, so results do not depend on
/// it. One writer; concurrent const access is safe while nobody writes.
class VoxelMap {
 public:
  explicit VoxelMap(const VoxelMapConfig& config);

  void clear() { reset(config_.voxel_size_m); }
  /// Clears the map and sets the voxel size.
  void reset(double voxel_size_m);
  /// Inserts the points of one scan in the map frame, with the beam of each point (or none, if beams are not
  /// checked).
  void insert(std::span<const Vector3> points, std::span<const float> beams = {});
  /// Visits a tenth of the slab and evicts voxels beyond the radius around `center`: bounded work per scan.
  void evict_far_from(const Vector3& center);

  [[nodiscard]] VoxelIndex index_of(const Vector3& position) const {
    const auto floor = [](double cell) {
      const int truncated = static_cast<int>(cell);
      return truncated - (cell < static_cast<double>(truncated) ? 1 : 0);
    };
    return {floor(position.x() * inverse_size_), floor(position.y() * inverse_size_),
            floor(position.z() * inverse_size_)};
  }
  [[nodiscard]] Vector3 corner_of(const VoxelIndex& index) const {
    return index.cast<double>() * config_.voxel_size_m;
  }
  /// The Gaussian of a voxel, or nullptr.
  [[nodiscard]] const GaussianVoxel* find(const VoxelIndex& index) const { return find_key(pack_key(index)); }
  /// find() for several voxels with interleaved memory accesses.
  template <std::size_t count>
  void find_all(const std::array<VoxelIndex, count>& indices, std::size_t used,
                std::array<const GaussianVoxel*, count>& surfaces) const {
    std::array<std::uint64_t, count> keys;
    for (std::size_t i = 0; i < used; ++i) {
      keys[i] = pack_key(indices[i]);
      __builtin_prefetch(&slots_[home_slot(keys[i])]);
    }
    // The home slot is nearly always the right one.
    for (std::size_t i = 0; i < used; ++i) {
      const Slot& home = slots_[home_slot(keys[i])];
      if (home.voxel != kNoVoxel) __builtin_prefetch(&surfaces_[home.voxel]);
    }
    for (std::size_t i = 0; i < used; ++i) surfaces[i] = find_key(keys[i]);
  }

  [[nodiscard]] const VoxelMapConfig& config() const { return config_; }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  static constexpr std::uint32_t kNoVoxel = 0xFFFFFFFFU;
  static constexpr std::int64_t kAxisOffset = 1 << 20;
  static constexpr std::uint64_t kAxisMask = (1ULL << 21U) - 1ULL;

  // Insertion data: one cache line. Positions are relative to the voxel centre, in voxels.
  struct alignas(64) Moments {
    std::uint64_t key = 0;
    float sum[3] = {};
    float products[6] = {};  ///< upper triangle: xx xy xz yy yz zz
    float min_beam = 0.0F;
    float max_beam = 0.0F;
    std::uint16_t count = 0;
    std::uint16_t refresh_at = 0;
    std::uint16_t last_scan = 0;
    bool occupied = false;
  };
  struct Slot {
    std::uint32_t key_low = 0;
    std::uint32_t voxel = kNoVoxel;
  };

  [[nodiscard]] bool seen_by_several_beams(const Moments& moments) const {
    return moments.max_beam - moments.min_beam >= config_.min_beam_spread;
  }
  // 21 bits per axis: +-1048 km at 1 m. Positions outside wrap onto evicted voxels.
  [[nodiscard]] static std::uint64_t pack_key(const VoxelIndex& index) {
    const auto axis = [](int value) { return static_cast<std::uint64_t>(value + kAxisOffset) & kAxisMask; };
    return axis(index.x()) | (axis(index.y()) << 21U) | (axis(index.z()) << 42U);
  }
  [[nodiscard]] static VoxelIndex unpack_key(std::uint64_t key) {
    const auto axis = [](std::uint64_t bits) {
      return static_cast<int>(static_cast<std::int64_t>(bits & kAxisMask) - kAxisOffset);
    };
    return {axis(key), axis(key >> 21U), axis(key >> 42U)};
  }
  [[nodiscard]] std::size_t home_slot(std::uint64_t key) const {
    constexpr std::uint64_t kFibonacci = 0x9E3779B97F4A7C15ULL;
    return (key * kFibonacci) >> 32U & mask_;
  }
  [[nodiscard]] std::size_t find_slot(std::uint64_t key) const {
    const auto low = static_cast<std::uint32_t>(key);
    const auto high = static_cast<std::uint32_t>(key >> 32U);
    std::size_t slot = home_slot(key);
    while (slots_[slot].voxel != kNoVoxel &&
           (slots_[slot].key_low != low || surfaces_[slots_[slot].voxel].key_high != high))
      slot = (slot + 1) & mask_;
    return slot;
  }
  [[nodiscard]] const GaussianVoxel* find_key(std::uint64_t key) const {
    const Slot& slot = slots_[find_slot(key)];
    if (slot.voxel == kNoVoxel) return nullptr;
    const GaussianVoxel& surface = surfaces_[slot.voxel];
    return surface.count > 0 ? &surface : nullptr;
  }
  std::uint32_t find_or_create(std::uint64_t key);
  void erase(std::uint32_t voxel);
  void add(std::uint32_t voxel, const Eigen::Vector3f& local, float beam);
  void refresh(std::uint32_t voxel);

  VoxelMapConfig config_;
  double inverse_size_ = 1.0;
  std::vector<GaussianVoxel> surfaces_;
  std::vector<Moments> moments_;
  std::vector<Slot> slots_;
  std::vector<std::uint32_t> free_;
  std::size_t mask_ = 0;
  std::size_t size_ = 0;
  std::uint32_t used_ = 0;  ///< voxels from this one on have never been used since the map was empty
  std::size_t sweep_position_ = 0;
  std::uint64_t refused_ = 0;
  std::uint16_t scan_ = 0;  ///< of the last insertion; 0 is none
};

}  // namespace nilio::core
