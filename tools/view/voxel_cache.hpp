#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace nilio::tools::view {

/// Set of voxels in bounded memory: buckets of eight keys that grow with the number of voxels up to
/// kMaxBytes; from then on the oldest key of a full bucket is forgotten. One thread.
class VoxelCache {
 public:
  static constexpr std::size_t kMaxBytes = std::size_t{64} << 20U;

  /// `max_bytes`: power of two.
  explicit VoxelCache(std::size_t max_bytes = kMaxBytes);

  /// True if the key was not in the set.
  bool insert(std::uint64_t key);
  [[nodiscard]] std::size_t bytes() const { return table_.size() * sizeof(Bucket); }

 private:
  // Newest key first.
  using Bucket = std::array<std::uint64_t, 8>;

  static bool insert(std::vector<Bucket>& table, std::uint64_t key);

  std::size_t max_buckets_;
  std::size_t keys_ = 0;
  std::vector<Bucket> table_;
};

}  // namespace nilio::tools::view
