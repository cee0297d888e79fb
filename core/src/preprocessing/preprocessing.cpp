#include "core/src/preprocessing/preprocessing.hpp"

#include "core/src/prefault.hpp"

namespace nilio::core {

Preprocessing::Preprocessing(const OdometryConfig& config)
    : config_{config.min_range_m, config.max_range_m, config.filter_voxel_m, config.elevation_correction_rad,
              config.scan_points},
      T_base_lidar_(config.T_base_lidar),
      downsampler_(config.max_filtered_points) {
  prefault(config.max_filtered_points, sweep_, deskewed_);
}

void Preprocessing::filter(const Scan& scan, std::size_t points, float voxel_share) {
  is_dense_ = voxel_share < 1.0F;
  ScanFilterConfig config = config_;
  config.voxel_size_m *= voxel_share;
  config.max_points = points;
  filter_scan(scan, config, T_base_lidar_, beam_calibration_, downsampler_, sweep_);
  if (!scan.motion_compensated) return;
  for (SweepPoint& point : sweep_) point.time_s = 0.0F;
}

const std::vector<Eigen::Vector3f>& Preprocessing::deskew(const std::vector<SweepPoint>& sweep,
                                                          const SweepMotion& motion) {
  motion.deskew(sweep, deskewed_);
  return deskewed_;
}

void Preprocessing::move_deskewed(const SE3& T_frame_middle) {
  const Eigen::Matrix3f R = T_frame_middle.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = T_frame_middle.translation.cast<float>();
  for (Eigen::Vector3f& point : deskewed_) point = R * point + t;
}

}  // namespace nilio::core
