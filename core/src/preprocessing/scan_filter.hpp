#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"

#include "core/src/preprocessing/beam_calibration.hpp"
#include "core/src/preprocessing/voxel_downsampling.hpp"

#include <cstddef>
#include <limits>
#include <vector>

#include <Eigen/Core>

namespace nilio::core {

/// A filtered point, in base_link at its own firing time until it is deskewed.
struct SweepPoint {
  Eigen::Vector3f position = Eigen::Vector3f::Zero();
  /// Seconds relative to the end of the scan (zero or negative).
  float time_s = 0.0F;
  /// Identifies the beam: its number, or the sine of its elevation in beam spacings.
  float beam = 0.0F;
  /// Reflectivity as the sensor reports it.
  float intensity = 0.0F;
};

struct ScanFilterConfig {
  float min_range_m = 1.0F;
  float max_range_m = 100.0F;
  float voxel_size_m = 0.5F;
  /// Raises every beam by this angle about the sensor's origin.
  float elevation_correction_rad = 0.0F;
  /// Points to visit, spread evenly over the scan.
  std::size_t max_points = std::numeric_limits<std::size_t>::max();
};

/// Range gate and voxel filter (NI-LIO 3.1), then transformation into base_link. Points that are not finite
/// are dropped. `calibration` corrects points with a beam number. `output` keeps its capacity.
void filter_scan(const Scan& scan, const ScanFilterConfig& config, const SE3& T_base_lidar,
                 const BeamCalibration& calibration, VoxelDownsampler& filter,
                 std::vector<SweepPoint>& output);

}  // namespace nilio::core
