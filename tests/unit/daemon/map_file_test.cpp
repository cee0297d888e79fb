#include "daemon/output/map_file.hpp"

#include "tests/support/temporary_folder.hpp"

#include <fstream>
#include <iterator>
#include <set>
#include <string>

#include <catch2/catch.hpp>

using namespace nilio;
using daemon::CloudRecord;
using daemon::MapFile;
using daemon::VoxelCache;

namespace {

std::string content_of(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// Points on a line, 1 m apart.
CloudRecord cloud(int first, std::uint32_t count) {
  CloudRecord record;
  record.count = count;
  for (std::uint32_t i = 0; i < count; ++i)
    record.points[i] = {static_cast<float>(first) + static_cast<float>(i), 0.5F, -0.5F};
  return record;
}

}  // namespace

TEST_CASE("the voxel cache tells known voxels exactly while it has memory", "[map_file]") {
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

TEST_CASE("the voxel cache never exceeds its memory and keeps the newest voxels", "[map_file]") {
  VoxelCache cache(std::size_t{1} << 20U);
  for (std::uint64_t key = 0; key < 2'000'000; ++key) cache.insert(key);
  CHECK(cache.bytes() == std::size_t{1} << 20U);
  std::uint64_t again = 0;
  for (std::uint64_t key = 1'990'000; key < 2'000'000; ++key) again += cache.insert(key) ? 1 : 0;
  CHECK(again < 100);
}

TEST_CASE("map.ply has one point a voxel, and its header counts what is in the file at any time",
          "[map_file]") {
  const tests::TemporaryFolder folder;
  const auto path = folder.path() / "map.ply";
  MapFile map(path, 0.3);
  map.add(cloud(0, 10));
  map.add(cloud(5, 10));
  REQUIRE(map.file().write_pending() == 0);
  REQUIRE(map.update_count() == 0);
  const std::string first = content_of(path);
  CHECK(first.find("element vertex 15\n") != std::string::npos);
  map.add(cloud(100, 1000));
  REQUIRE(map.file().write_pending() == 0);
  REQUIRE(map.update_count() == 0);
  const std::string text = content_of(path);
  CHECK(text.find("element vertex 1015\n") != std::string::npos);
  const std::string end = "end_header\n";
  CHECK(text.size() == text.find(end) + end.size() + 1015 * 12);
}
