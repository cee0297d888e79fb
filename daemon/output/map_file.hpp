#pragma once

#include "nilio/drivers/capture/record_file.hpp"

#include "daemon/odometry/odometry_loop.hpp"

#include <array>
#include <cstdint>
#include <filesystem>

namespace nilio::daemon {

/// Set of voxels in bounded memory that is never locked: buckets of eight keys that grow with the number of
/// voxels up to kMaxBytes; from then on the oldest key of a full bucket is forgotten. One thread.
class VoxelCache {
 public:
  static constexpr std::size_t kMaxBytes = std::size_t{64} << 20U;

  /// `max_bytes`: power of two.
  explicit VoxelCache(std::size_t max_bytes = kMaxBytes);
  VoxelCache(const VoxelCache&) = delete;
  VoxelCache& operator=(const VoxelCache&) = delete;
  ~VoxelCache();

  /// True if the key was not in the set.
  bool insert(std::uint64_t key);
  [[nodiscard]] std::size_t bytes() const { return buckets_ * sizeof(Bucket); }

 private:
  // Newest key first; kEmpty marks a free place.
  using Bucket = std::array<std::uint64_t, 8>;
  static constexpr std::uint64_t kEmpty = ~std::uint64_t{0};

  static Bucket* allocate(std::size_t buckets);
  static bool insert(Bucket* table, std::size_t buckets, std::uint64_t key);
  void grow();

  std::size_t max_buckets_;
  std::size_t buckets_ = 0;
  std::size_t keys_ = 0;
  Bucket* table_ = nullptr;
};

/// map.ply of a run: one point per voxel, appended while the run goes on. The number of points in the header
/// is corrected at every update_count(), so that the file is complete after an abrupt end, too. One thread.
class MapFile {
 public:
  MapFile(std::filesystem::path path, double voxel_m);

  void add(const CloudRecord& cloud);
  /// Writes the number of points on disk into the header. 0 or errno.
  int update_count();
  [[nodiscard]] drivers::RecordFile& file() { return file_; }
  /// Points dropped because the disk did not accept data.
  [[nodiscard]] std::uint64_t lost() const { return lost_; }

 private:
  drivers::RecordFile file_;
  double voxel_m_;
  VoxelCache voxels_;
  std::uint64_t lost_ = 0;
  std::uint64_t counted_ = 0;
};

}  // namespace nilio::daemon
