#pragma once

#include "nilio/core/odometry_config.hpp"
#include "nilio/core/se3.hpp"

#include "core/src/map/gaussian_voxel_map.hpp"
#include "core/src/map/map_drift.hpp"
#include "core/src/map/point_voxel_map.hpp"
#include "core/src/preprocessing/scan_filter.hpp"
#include "core/src/preprocessing/voxel_downsampling.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace nilio::core {

/// Voxel of the points for the NDT map and of the candidates for registration.
inline constexpr float kCoarseVoxelMetres = 1.0F;

/// Surroundings of one odometry as three readings of the same points: planes for ICP, larger Gaussians for
/// NDT, and points for the methods that need them. Memory is allocated at construction. One writer;
/// concurrent const access is safe while nobody writes.
class LocalMap {
 public:
  LocalMap(const OdometryConfig& config, bool needs_points);

  /// Empties the map and sets the voxel of the planes.
  void reset(double plane_voxel_m);
  /// Inserts a deskewed sweep from the pose of its frame; `coarse_voxel_m` thins its points for NDT.
  void insert(const std::vector<SweepPoint>& sweep, const std::vector<Eigen::Vector3f>& points,
              const SE3& T_map_moving, float coarse_voxel_m);
  /// Whether a pose is another one than that of the last insertion, beyond the noise of a stationary vehicle.
  [[nodiscard]] bool is_elsewhere(const SE3& T_map_moving) const;
  /// Evicts what is beyond the radius around a place, a bounded amount at each call.
  void evict_far_from(const Vector3& place);

  /// Drift of this map and of those before it.
  [[nodiscard]] MapDrift& drift() { return drift_; }
  [[nodiscard]] const MapDrift& drift() const { return drift_; }
  [[nodiscard]] const VoxelMap& planes() const { return planes_; }
  [[nodiscard]] const VoxelMap& gaussians() const { return gaussians_; }
  /// Null for methods that do not need points.
  [[nodiscard]] const PointMap* points() const { return points_ ? &*points_ : nullptr; }
  [[nodiscard]] double plane_voxel_m() const { return planes_.config().voxel_size_m; }
  /// Points refused for lack of voxels.
  [[nodiscard]] std::uint64_t refused() const { return planes_.refused() + gaussians_.refused(); }

 private:
  void insert_planes(const std::vector<SweepPoint>& sweep);
  void insert_gaussians(const std::vector<Eigen::Vector3f>& points, float voxel_m);

  VoxelMap planes_;
  VoxelMap gaussians_;
  std::optional<PointMap> points_;
  MapDrift drift_;
  SE3 T_inserted_;  ///< pose of the last insertion
  VoxelDownsampler downsampler_;
  std::vector<Vector3> map_points_;
  std::vector<Vector3> coarse_map_points_;
  std::vector<float> beams_;
};

}  // namespace nilio::core
