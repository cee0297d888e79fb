#include "core/src/map/local_map.hpp"

#include "core/src/prefault.hpp"
#include "core/src/thread_sanitizer.hpp"

#include <algorithm>

#include <tbb/parallel_invoke.h>

namespace nilio::core {

namespace {

// Distance at which two neighbouring beams meet a wall in one plane voxel, as 16 beams require.
constexpr double kPlaneReachMetres = 45.0;
constexpr double kMinPlaneVoxelMetres = 1.0;
constexpr double kMaxPlaneVoxelMetres = 2.0;
// Beam numbers that differ by this belong to different beams.
constexpr float kBeamSpread = 0.5F;
constexpr double kPointVoxelMetres = 1.0;
// Displacement that noise alone does not give a stationary vehicle.
constexpr double kStationaryMetres = 0.02;
constexpr double kStationaryRadians = 0.002;

VoxelMapConfig plane_map_config(const OdometryConfig& config) {
  VoxelMapConfig result{plane_voxel_for(config, 0.0F), config.map_radius_m, config.map_capacity};
  result.min_beam_spread = kBeamSpread;
  return result;
}

}  // namespace

double plane_voxel_for(const OdometryConfig& config, float beam_spacing_rad) {
  if (config.plane_voxel_m > 0.0) return config.plane_voxel_m;
  return std::clamp(kPlaneReachMetres * static_cast<double>(beam_spacing_rad), kMinPlaneVoxelMetres,
                    kMaxPlaneVoxelMetres);
}

LocalMap::LocalMap(const OdometryConfig& config, bool needs_points)
    : planes_(plane_map_config(config)),
      gaussians_({config.coarse_voxel_m, config.map_radius_m, config.coarse_map_capacity}),
      downsampler_(config.max_filtered_points) {
  if (needs_points)
    points_.emplace(PointMapConfig{kPointVoxelMetres, config.map_radius_m, config.map_capacity});
  prefault(config.max_filtered_points, map_points_, coarse_map_points_, beams_);
}

void LocalMap::reset(double plane_voxel_m) {
  planes_.reset(plane_voxel_m);
  gaussians_.clear();
  if (points_) points_->clear();
}

void LocalMap::insert(const std::vector<SweepPoint>& sweep, const std::vector<Eigen::Vector3f>& points,
                      const SE3& T_map_moving, float coarse_voxel_m) {
  T_inserted_ = T_map_moving;
  const Matrix3 R = T_map_moving.rotation.toRotationMatrix();
  map_points_.clear();
  for (const Eigen::Vector3f& p : points)
    map_points_.emplace_back(R * p.cast<double>() + T_map_moving.translation);
  // The two insertions are independent. `order` is only an address for the ThreadSanitizer annotations.
  static char order;
  const auto feed_planes = [&] {
    sanitizer_acquire(&order);
    insert_planes(sweep);
    sanitizer_release(&order);
  };
  const auto feed_gaussians = [&] {
    sanitizer_acquire(&order);
    insert_gaussians(points, coarse_voxel_m);
    sanitizer_release(&order);
  };
  sanitizer_release(&order);
  tbb::parallel_invoke(feed_planes, feed_gaussians);
  sanitizer_acquire(&order);
}

void LocalMap::insert_planes(const std::vector<SweepPoint>& sweep) {
  beams_.clear();
  for (const SweepPoint& point : sweep) beams_.push_back(point.beam);
  planes_.insert(map_points_, beams_);
  if (points_) points_->insert(map_points_);
}

/// NDT needs few points per voxel: thinned in the order of the scan.
void LocalMap::insert_gaussians(const std::vector<Eigen::Vector3f>& points, float voxel_m) {
  downsampler_.begin(voxel_m);
  coarse_map_points_.clear();
  const auto position_of = [&](std::size_t i, Eigen::Vector3f& position) {
    position = points[i];
    return true;
  };
  downsampler_.thin(points.size(), position_of,
                    [&](std::size_t i) { coarse_map_points_.push_back(map_points_[i]); });
  gaussians_.insert(coarse_map_points_);
}

bool LocalMap::is_elsewhere(const SE3& T_map_moving) const {
  const SE3 since = T_inserted_.inverse() * T_map_moving;
  return since.translation.norm() > kStationaryMetres || so3_log(since.rotation).norm() > kStationaryRadians;
}

void LocalMap::evict_far_from(const Vector3& place) {
  planes_.evict_far_from(place);
  if (points_) points_->evict_far_from(place);
  gaussians_.evict_far_from(place);
}

}  // namespace nilio::core
