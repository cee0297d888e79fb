#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace nilio::core {

/// Keeps the first point of every voxel. The table is stamped with a generation instead of being cleared, so
/// that a scan costs its points and not the table's size.
class VoxelDownsampler {
 public:
  /// Where a point belongs: 16 bits an axis. Points farther than 32,767 voxels from the origin share the
  /// outermost ones.
  using Key = std::uint64_t;

  /// `capacity` bounds the survivors of one pass (rounded up to a power of two, half of it usable).
  explicit VoxelDownsampler(std::size_t capacity);

  /// Starts a pass with the given voxel size, metres.
  void begin(float voxel_size_m);
  /// True for the first point in its voxel since begin(); false for all others, when the table is full, and
  /// for what is not finite.
  [[nodiscard]] bool insert(const Eigen::Vector3f& position) { return insert_key(key_of(position)); }

  /// Calls `keep(i)` for the first point of each voxel, in order, of `count` points `i = index_of(0)`,
  /// `index_of(1)`, ...; those for which `position_of(i, position)` is false are passed over. Faster than
  /// insert() point by point: the table's lines are fetched motion_prior.
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

}  // namespace nilio::core
