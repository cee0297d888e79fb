#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace nilio::core {

/// Keeps the first point of every voxel. Slots carry a generation instead of being cleared: a pass costs its
/// points, not the size of the table.
class VoxelDownsampler {
 public:
  /// Voxel key: 16 bits per axis. Points beyond 32,767 voxels share the outermost ones.
  using Key = std::uint64_t;

  /// Capacity of a pass (rounded up to a power of two, half of it usable).
  explicit VoxelDownsampler(std::size_t capacity);

  /// Starts a pass with the given voxel size, metres.
  void begin(float voxel_size_m);
  /// True for the first point in its voxel since begin(); false for others, when the table is full, and for
  /// NaN.
  [[nodiscard]] bool insert(const Eigen::Vector3f& position) { return insert_key(key_of(position)); }

  /// Calls `keep(i)` for the first point of each voxel, for `count` points i = index_of(0), index_of(1), ...;
  /// points with false `position_of(i, position)` are skipped. Faster than insert(): table lines are
  /// prefetched.
  template <class IndexOf, class PositionOf, class Keep>
  void thin(std::size_t count, const IndexOf& index_of, const PositionOf& position_of, const Keep& keep) {
    constexpr std::size_t kBlock = 32;
    std::array<Key, kBlock> keys;
    std::array<std::size_t, kBlock> indices;
    for (std::size_t begin = 0; begin < count; begin += kBlock) {
      const std::size_t end = std::min(count, begin + kBlock);
      std::size_t used = 0;
      Eigen::Vector3f position;
      for (std::size_t k = begin; k < end; ++k) {
        const std::size_t i = index_of(k);
        if (!position_of(i, position)) continue;
        keys[used] = key_of(position);
        __builtin_prefetch(&slots_[home_of(keys[used])], 1);
        indices[used] = i;
        ++used;
      }
      for (std::size_t k = 0; k < used; ++k) {
        if (insert_key(keys[k])) keep(indices[k]);
      }
    }
  }

  /// The same for the points 0, 1, ... `count` - 1.
  template <class PositionOf, class Keep>
  void thin(std::size_t count, const PositionOf& position_of, const Keep& keep) {
    thin(
        count, [](std::size_t k) { return k; }, position_of, keep);
  }

 private:
  static constexpr unsigned kGenerationBits = 16;
  static constexpr Key kNoKey = ~Key{0};

  [[nodiscard]] Key key_of(const Eigen::Vector3f& position) const {
    const Eigen::Vector3f cells = position * inverse_size_;
    // Also false for NaN.
    if (!(cells.cwiseAbs().sum() < 1e9F)) return kNoKey;
    const auto axis = [](float cell) {
      constexpr float kLimit = 32767.0F;
      const float bounded = std::clamp(cell, -kLimit, kLimit);
      const int truncated = static_cast<int>(bounded);
      const int floor = truncated - (bounded < static_cast<float>(truncated) ? 1 : 0);
      return static_cast<Key>(floor + 32768);
    };
    return axis(cells.x()) | (axis(cells.y()) << 16U) | (axis(cells.z()) << 32U);
  }
  [[nodiscard]] std::size_t home_of(Key key) const {
    constexpr std::uint64_t kFibonacci = 0x9E3779B97F4A7C15ULL;
    return (key * kFibonacci) >> 32U & mask_;
  }
  bool insert_key(Key key) {
    if (key == kNoKey) return false;
    const std::uint64_t wanted = key << kGenerationBits | generation_;
    constexpr std::uint64_t kGenerationMask = (1U << kGenerationBits) - 1U;
    std::size_t slot = home_of(key);
    while ((slots_[slot] & kGenerationMask) == generation_) {
      if (slots_[slot] == wanted) return false;
      slot = (slot + 1) & mask_;
    }
    if (used_ * 2 >= slots_.size()) return false;
    slots_[slot] = wanted;
    ++used_;
    return true;
  }

  std::vector<std::uint64_t> slots_;  ///< key and, below it, the generation that wrote it
  std::size_t mask_ = 0;
  std::size_t used_ = 0;
  std::uint64_t generation_ = 0;
  float inverse_size_ = 1.0F;
};

inline VoxelDownsampler::VoxelDownsampler(std::size_t capacity)
    : slots_(std::bit_ceil(2 * capacity)), mask_(slots_.size() - 1) {}

inline void VoxelDownsampler::begin(float voxel_size_m) {
  inverse_size_ = 1.0F / voxel_size_m;
  used_ = 0;
  if (++generation_ >> kGenerationBits != 0) {
    std::fill(slots_.begin(), slots_.end(), 0);
    generation_ = 1;
  }
}

}  // namespace nilio::core
