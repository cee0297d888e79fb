#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"

#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace nilio::core {

/// A point that survived filtering: base_link frame at its own firing time until it is deskewed.
struct SweepPoint {
  Eigen::Vector3f position = Eigen::Vector3f::Zero();
  /// Seconds relative to the end of the scan (zero or negative).
  float time_s = 0.0F;
  /// Tells the beams apart: the number of the one that saw it, or its elevation in beam spacings.
  float beam = 0.0F;
};

/// Keeps the first point of every voxel. The table is stamped with a generation instead of being cleared, so
/// that a scan costs its points and not the table's size.
class VoxelFilter {
 public:
  /// `capacity` bounds the survivors of one pass (rounded up to a power of two, half of it usable).
  explicit VoxelFilter(std::size_t capacity);

  /// Starts a pass with the given voxel size, metres.
  void begin(float voxel_size_m);
  /// True for the first point in its voxel since begin(); false for all others and when the table is full.
  [[nodiscard]] bool insert(const Eigen::Vector3f& position);

 private:
  struct Slot {
    std::uint64_t key = 0;
    std::uint32_t generation = 0;
  };
  std::vector<Slot> slots_;
  std::size_t mask_ = 0;
  std::size_t used_ = 0;
  std::uint32_t generation_ = 0;
  float inverse_size_ = 1.0F;
};

struct ScanFilterConfig {
  float min_range_m = 1.0F;
  float max_range_m = 100.0F;
  float voxel_size_m = 0.5F;
  /// Raises every beam by this angle about the sensor's origin.
  float elevation_correction_rad = 0.0F;
};

/// Range gate and voxel filter (NI-LIO 3.1), then into base_link. Points that are not finite are left out.
/// `output` keeps its capacity.
void filter_scan(const Scan& scan, const ScanFilterConfig& config, const SE3& T_base_lidar,
                 VoxelFilter& filter, std::vector<SweepPoint>& output);

}  // namespace nilio::core
