#include "nilio/core/sweep.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

/// Turns a point about the horizontal axis across its direction, upwards.
Eigen::Vector3f raise_beam(const Eigen::Vector3f& p, float cosine, float sine) {
  const float horizontal = p.head<2>().norm();
  if (horizontal == 0.0F) return p;
  const float shrink = cosine - p.z() / horizontal * sine;
  return {p.x() * shrink, p.y() * shrink, p.z() * cosine + horizontal * sine};
}

}  // namespace

void filter_scan(const Scan& scan, const ScanFilterConfig& config, const SE3& T_base_lidar,
                 VoxelFilter& filter, std::vector<SweepPoint>& output) {
  output.clear();
  filter.begin(config.voxel_size_m);
  const float min_square = config.min_range_m * config.min_range_m;
  const float max_square = config.max_range_m * config.max_range_m;
  const Eigen::Matrix3f R_base_lidar = T_base_lidar.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t_base_lidar = T_base_lidar.translation.cast<float>();
  const auto sweep_ns = (scan.end - scan.start).ns;
  const float cosine = std::cos(config.elevation_correction_rad);
  const float sine = std::sin(config.elevation_correction_rad);
  // KITTI's files have no numbers of beams. The sine of the elevation tells them apart as well.
  const bool numbered =
      std::any_of(scan.points.begin(), scan.points.end(), [](const Point& point) { return point.ring != 0; });
  const auto position_of = [&](std::size_t i, Eigen::Vector3f& p) {
    const Point& point = scan.points[i];
    p = {point.x, point.y, point.z};
    const float square = p.squaredNorm();
    // Also false for NaN.
    return square >= min_square && square <= max_square;
  };
  filter.thin(scan.points.size(), position_of, [&](std::size_t i) {
    const Point& point = scan.points[i];
    Eigen::Vector3f p(point.x, point.y, point.z);
    const float beam = numbered ? static_cast<float>(point.ring) : p.z() / p.norm() / scan.beam_spacing_rad;
    if (sine != 0.0F) p = raise_beam(p, cosine, sine);
    const float time_s = static_cast<float>(static_cast<double>(point.time_offset_ns - sweep_ns) * 1e-9);
    output.push_back({R_base_lidar * p + t_base_lidar, time_s, beam});
  });
}

}  // namespace nilio::core
