#pragma once

#include "nilio/core/odometry_config.hpp"

#include "core/src/preprocessing/deskewing.hpp"
#include "core/src/preprocessing/scan_filter.hpp"

#include <cstddef>
#include <vector>

namespace nilio::core {

/// Preprocessing of one LiDAR's scans (NI-LIO 3.1), with what is found about its beams. Not thread-safe.
class Preprocessing {
 public:
  explicit Preprocessing(const OdometryConfig& config);

  /// Filters a scan, visiting `points` of it, in voxels of `voxel_share` of the configured one.
  void filter(const Scan& scan, std::size_t points, float voxel_share);
  /// The filtered points; without times where the scan is motion-compensated.
  [[nodiscard]] const std::vector<SweepPoint>& sweep() const { return sweep_; }
  /// Whether it is denser than configured.
  [[nodiscard]] bool is_dense() const { return is_dense_; }

  /// Deskews a sweep to its midpoint; valid until the next call.
  const std::vector<Eigen::Vector3f>& deskew(const std::vector<SweepPoint>& sweep, const SweepMotion& motion);
  /// Moves the deskewed points to another frame.
  void move_deskewed(const SE3& T_frame_middle);
  [[nodiscard]] const std::vector<Eigen::Vector3f>& deskewed() const { return deskewed_; }

  [[nodiscard]] BeamCalibration& beam_calibration() { return beam_calibration_; }
  [[nodiscard]] const BeamCalibration& beam_calibration() const { return beam_calibration_; }

 private:
  ScanFilterConfig config_;
  SE3 T_base_lidar_;
  VoxelDownsampler downsampler_;
  BeamCalibration beam_calibration_;
  std::vector<SweepPoint> sweep_;
  bool is_dense_ = false;
  std::vector<Eigen::Vector3f> deskewed_;
};

}  // namespace nilio::core
