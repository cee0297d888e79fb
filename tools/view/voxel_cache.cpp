#include "tools/view/voxel_cache.hpp"

#include <algorithm>
#include <bit>
#include <ranges>
#include <utility>

namespace nilio::tools::view {

namespace {

constexpr std::size_t kFirstBuckets = 4096;
/// Marks a free place.
constexpr std::uint64_t kEmpty = ~std::uint64_t{0};
constexpr std::array kNoKeys{kEmpty, kEmpty, kEmpty, kEmpty, kEmpty, kEmpty, kEmpty, kEmpty};

/// Finaliser of SplitMix64 (Steele, Lea, Flood 2014).
std::uint64_t mix(std::uint64_t key) {
  key = (key ^ (key >> 30U)) * 0xBF58476D1CE4E5B9U;
  key = (key ^ (key >> 27U)) * 0x94D049BB133111EBU;
  return key ^ (key >> 31U);
}

}  // namespace

VoxelCache::VoxelCache(std::size_t max_bytes)
    : max_buckets_(std::max<std::size_t>(std::bit_floor(max_bytes / sizeof(Bucket)), 1)),
      table_(std::min(kFirstBuckets, max_buckets_), kNoKeys) {}

bool VoxelCache::insert(std::vector<Bucket>& table, std::uint64_t key) {
  Bucket& bucket = table[mix(key) & (table.size() - 1)];
  if (std::find(bucket.begin(), bucket.end(), key) != bucket.end()) return false;
  std::move_backward(bucket.begin(), bucket.end() - 1, bucket.end());
  bucket.front() = key;
  return true;
}

bool VoxelCache::insert(std::uint64_t key) {
  if (!insert(table_, key)) return false;
  // With more than a quarter of the places taken, single buckets begin to overflow.
  if (++keys_ <= table_.size() * kNoKeys.size() / 4 || table_.size() >= max_buckets_) return true;
  std::vector<Bucket> larger(2 * table_.size(), kNoKeys);
  for (const Bucket& bucket : table_) {
    // The oldest first, so that the newest stays in front.
    for (const std::uint64_t known : bucket | std::views::reverse) {
      if (known != kEmpty) insert(larger, known);
    }
  }
  table_ = std::move(larger);
  return true;
}

}  // namespace nilio::tools::view
