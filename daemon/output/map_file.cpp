#include "daemon/output/map_file.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <new>
#include <string>
#include <sys/mman.h>
#include <utility>
#include <vector>

namespace nilio::daemon {

namespace {

constexpr std::size_t kFirstBuckets = 4096;
constexpr std::size_t kPointBytes = 12;
constexpr std::size_t kHeaderBytes = 160;

/// Header of constant size for any number of points: a comment fills it up.
std::vector<std::uint8_t> header(std::uint64_t points) {
  const std::string before = "ply\nformat binary_little_endian 1.0\ncomment nilio ";
  const std::string after = "\nelement vertex " + std::to_string(points) +
                            "\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
  const std::string text = before + std::string(kHeaderBytes - before.size() - after.size(), '.') + after;
  return {text.begin(), text.end()};
}

std::uint64_t voxel_key(const std::array<float, 3>& point, double voxel_m) {
  std::uint64_t key = 0;
  for (const float value : point) {
    const auto cell = static_cast<std::int64_t>(std::floor(static_cast<double>(value) / voxel_m));
    key = key << 21U | (static_cast<std::uint64_t>(cell) & 0x1FFFFFU);
  }
  return key;
}

/// Finaliser of SplitMix64 (Steele, Lea, Flood 2014).
std::uint64_t mix(std::uint64_t key) {
  key = (key ^ (key >> 30U)) * 0xBF58476D1CE4E5B9U;
  key = (key ^ (key >> 27U)) * 0x94D049BB133111EBU;
  return key ^ (key >> 31U);
}

}  // namespace

VoxelCache::VoxelCache(std::size_t max_bytes)
    : max_buckets_(std::max<std::size_t>(std::bit_floor(max_bytes / sizeof(Bucket)), 1)),
      buckets_(std::min(kFirstBuckets, max_buckets_)),
      table_(allocate(buckets_)) {}

VoxelCache::~VoxelCache() { munmap(table_, bytes()); }

VoxelCache::Bucket* VoxelCache::allocate(std::size_t buckets) {
  const std::size_t bytes = buckets * sizeof(Bucket);
  void* const memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) throw std::bad_alloc();
  // Only real-time memory is worth locking.
  munlock(memory, bytes);
  auto* const table = static_cast<Bucket*>(memory);
  std::for_each(table, table + buckets, [](Bucket& bucket) { bucket.fill(kEmpty); });
  return table;
}

bool VoxelCache::insert(Bucket* table, std::size_t buckets, std::uint64_t key) {
  Bucket& bucket = table[mix(key) & (buckets - 1)];
  if (std::find(bucket.begin(), bucket.end(), key) != bucket.end()) return false;
  std::move_backward(bucket.begin(), bucket.end() - 1, bucket.end());
  bucket.front() = key;
  return true;
}

void VoxelCache::grow() {
  const std::size_t more = 2 * buckets_;
  Bucket* const table = allocate(more);
  for (Bucket* bucket = table_; bucket != table_ + buckets_; ++bucket) {
    // The oldest first, so that the newest stays in front.
    for (auto key = bucket->rbegin(); key != bucket->rend(); ++key) {
      if (*key != kEmpty) insert(table, more, *key);
    }
  }
  munmap(table_, bytes());
  table_ = table;
  buckets_ = more;
}

bool VoxelCache::insert(std::uint64_t key) {
  if (!insert(table_, buckets_, key)) return false;
  // With more than a quarter of the places taken, single buckets begin to overflow.
  if (++keys_ > buckets_ * std::tuple_size_v<Bucket> / 4 && buckets_ < max_buckets_) grow();
  return true;
}

MapFile::MapFile(std::filesystem::path path, double voxel_m)
    : file_(std::move(path), header(0)), voxel_m_(voxel_m) {}

void MapFile::add(const CloudRecord& cloud) {
  for (std::size_t i = 0; i < cloud.count; ++i) {
    const std::array<float, 3>& point = cloud.points[i];
    if (!voxels_.insert(voxel_key(point, voxel_m_))) continue;
    if (!file_.append({reinterpret_cast<const std::uint8_t*>(point.data()), kPointBytes})) ++lost_;
  }
}

int MapFile::update_count() {
  if (file_.bytes() == 0) return 0;
  const std::uint64_t count = (file_.bytes() - kHeaderBytes) / kPointBytes;
  if (count == counted_) return 0;
  const int error = file_.overwrite(0, header(count));
  if (error == 0) counted_ = count;
  return error;
}

}  // namespace nilio::daemon
