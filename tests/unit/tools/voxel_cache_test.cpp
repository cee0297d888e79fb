#include "tools/view/voxel_cache.hpp"

#include <cstdint>

#include <catch2/catch.hpp>

using nilio::tools::view::VoxelCache;

TEST_CASE("the voxel cache tells known voxels exactly while it has memory", "[voxel_cache]") {
  VoxelCache cache(std::size_t{8} << 20U);
  constexpr std::uint64_t kKeys = 300'000;
  std::uint64_t once = 0;
  for (std::uint64_t key = 0; key < kKeys; ++key) once += cache.insert(key * 0x1234567U) ? 1 : 0;
  CHECK(once == kKeys);
  std::uint64_t again = 0;
  for (std::uint64_t key = 0; key < kKeys; ++key) again += cache.insert(key * 0x1234567U) ? 1 : 0;
  // Buckets that overflow have forgotten keys.
  CHECK(again < kKeys / 100);
  CHECK(cache.bytes() <= std::size_t{8} << 20U);
}

TEST_CASE("the voxel cache never exceeds its memory and keeps the newest voxels", "[voxel_cache]") {
  VoxelCache cache(std::size_t{1} << 20U);
  for (std::uint64_t key = 0; key < 2'000'000; ++key) cache.insert(key);
  CHECK(cache.bytes() == std::size_t{1} << 20U);
  std::uint64_t again = 0;
  for (std::uint64_t key = 1'990'000; key < 2'000'000; ++key) again += cache.insert(key) ? 1 : 0;
  CHECK(again < 100);
}
