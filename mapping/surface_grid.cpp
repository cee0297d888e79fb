#include "mapping/surface_grid.hpp"

#include "core/src/linear_algebra.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::mapping {

namespace {

// A plane has this many points, is this thin, and is no line of points.
constexpr std::uint32_t kMinPlanePoints = 5;
constexpr double kMaxThicknessMetres = 0.05;
constexpr double kMaxThicknessRatio = 0.1;
// Points seen once may be a moving object.
constexpr std::uint32_t kMinKeyframes = 2;
constexpr std::uint32_t kMinIrregularPoints = 4;

constexpr std::array<std::array<int, 2>, 6> kUpperTriangle{{{0, 0}, {0, 1}, {0, 2}, {1, 1}, {1, 2}, {2, 2}}};

struct Shape {
  Surface surface;
  double middle_variance = 0.0;
};

/// Surface of the sums, whatever its shape.
Shape shape_of(const VoxelSums& sums, const Eigen::Vector3f& centre) {
  const double count = sums.points;
  const core::Vector3 mean = sums.sum.cast<double>() / count;
  core::Matrix3 covariance;
  for (std::size_t i = 0; i < kUpperTriangle.size(); ++i) {
    const auto [row, column] = kUpperTriangle[i];
    covariance(row, column) = covariance(column, row) =
        static_cast<double>(sums.squares[i]) / count - mean[row] * mean[column];
  }
  const core::SymmetricEigen3 eigen = core::symmetric_eigen(covariance);
  core::Vector3 normal = eigen.vectors.col(0);
  if (normal.dot(sums.towards_sensor.cast<double>()) < 0.0) normal = -normal;
  Shape shape;
  shape.surface.mean = centre + mean.cast<float>();
  shape.surface.normal = normal.normalized().cast<float>();
  shape.surface.thickness_m = static_cast<float>(std::sqrt(std::max(eigen.values[0], 0.0)));
  shape.surface.intensity = sums.intensity / static_cast<float>(sums.points);
  shape.surface.points = sums.points;
  shape.surface.keyframe = sums.last_keyframe;
  shape.middle_variance = eigen.values[1];
  return shape;
}

bool is_plane(const Shape& shape) {
  const double thickness = shape.surface.thickness_m;
  return shape.surface.points >= kMinPlanePoints && thickness < kMaxThicknessMetres &&
         thickness * thickness < kMaxThicknessRatio * shape.middle_variance;
}

/// Index of the irregular voxel that contains a plane voxel, which is half as large.
Eigen::Vector3i parent_of(const Eigen::Vector3i& index) {
  return index.unaryExpr([](int i) { return i >= 0 ? i / 2 : (i - 1) / 2; });
}

}  // namespace

void VoxelSums::add(const VoxelSums& other, const Eigen::Vector3f& offset) {
  const auto count = static_cast<float>(other.points);
  for (std::size_t i = 0; i < kUpperTriangle.size(); ++i) {
    const auto [row, column] = kUpperTriangle[i];
    squares[i] += other.squares[i] + other.sum[row] * offset[column] + offset[row] * other.sum[column] +
                  count * offset[row] * offset[column];
  }
  sum += other.sum + count * offset;
  towards_sensor += other.towards_sensor;
  points += other.points;
  keyframes = std::max(keyframes, other.keyframes);
  last_keyframe = std::max(last_keyframe, other.last_keyframe);
  intensity += other.intensity;
}

void SurfaceGrid::add(const Eigen::Vector3f& point, float intensity, const Eigen::Vector3f& sensor,
                      std::uint16_t keyframe) {
  if (!point.allFinite()) return;
  const Eigen::Vector3i index = index_at(point, kPlaneVoxelMetres);
  const std::optional<VoxelKey> key = key_of(index);
  if (!key) return;
  auto found = voxels_.find(*key);
  if (found == voxels_.end()) {
    if (voxels_.size() >= capacity_) {
      ++refused_;
      return;
    }
    found = voxels_.try_emplace(*key).first;
  }
  VoxelSums& voxel = found->second;
  const Eigen::Vector3f d = point - centre_of(index, kPlaneVoxelMetres);
  if (voxel.points == 0 || voxel.last_keyframe != keyframe) {
    ++voxel.keyframes;
    voxel.towards_sensor += (sensor - point).normalized();
  }
  voxel.last_keyframe = keyframe;
  ++voxel.points;
  voxel.intensity += intensity;
  voxel.sum += d;
  for (std::size_t i = 0; i < kUpperTriangle.size(); ++i)
    voxel.squares[i] += d[kUpperTriangle[i][0]] * d[kUpperTriangle[i][1]];
}

VoxelSums* SurfaceGrid::find(VoxelKey key) {
  const auto found = voxels_.find(key);
  return found == voxels_.end() ? nullptr : &found->second;
}

std::vector<Surface> SurfaceGrid::surfaces() const {
  std::vector<VoxelKey> keys;
  keys.reserve(voxels_.size());
  for (const auto& [key, sums] : voxels_) {
    if (!sums.is_elsewhere && sums.keyframes >= kMinKeyframes) keys.push_back(key);
  }
  std::sort(keys.begin(), keys.end());
  std::vector<Surface> result;
  std::map<VoxelKey, VoxelSums> irregular;  // ordered
  for (const VoxelKey key : keys) {
    const VoxelSums& sums = voxels_.at(key);
    const Eigen::Vector3i index = index_of(key);
    const Eigen::Vector3f centre = centre_of(index, kPlaneVoxelMetres);
    const Shape shape = shape_of(sums, centre);
    if (is_plane(shape)) {
      result.push_back(shape.surface);
      continue;
    }
    const Eigen::Vector3i parent = parent_of(index);
    irregular[*key_of(parent)].add(sums, centre - centre_of(parent, kIrregularVoxelMetres));
  }
  for (const auto& [key, sums] : irregular) {
    if (sums.points < kMinIrregularPoints) continue;
    Surface surface = shape_of(sums, centre_of(index_of(key), kIrregularVoxelMetres)).surface;
    surface.is_plane = false;
    result.push_back(surface);
  }
  return result;
}

}  // namespace nilio::mapping
