#include "core/src/map/point_voxel_map.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace nilio::core {

namespace {

constexpr std::uint32_t kNoVoxel = 0xFFFFFFFFU;
// Share of the slab that eviction visits per scan, and the margin in cells that this requires of the grid.
constexpr std::size_t kPointSweepShare = 10;
constexpr double kCellsOfPlay = 24.0;
// The scene of a LiDAR is flat: the grid is a quarter as high as wide.
constexpr std::uint32_t kHeightShare = 4;
constexpr std::uint32_t kMinHeight = 32;

/// The 27 voxels around a point, home first, then by the number of steps away.
std::array<VoxelIndex, 27> make_neighbourhood() {
  std::array<VoxelIndex, 27> offsets;
  std::size_t count = 0;
  for (int steps = 0; steps <= 3; ++steps) {
    for (int x = -1; x <= 1; ++x) {
      for (int y = -1; y <= 1; ++y) {
        for (int z = -1; z <= 1; ++z) {
          if (std::abs(x) + std::abs(y) + std::abs(z) == steps) offsets[count++] = VoxelIndex(x, y, z);
        }
      }
    }
  }
  return offsets;
}

/// Square of the least distance from `local`, relative to the home voxel's corner, to the voxel at `offset`.
double square_distance_to(const VoxelIndex& offset, const Vector3& local, double size) {
  double sum = 0.0;
  for (int axis = 0; axis < 3; ++axis) {
    const double distance = offset[axis] == 0 ? 0.0 : offset[axis] > 0 ? size - local[axis] : local[axis];
    sum += distance * distance;
  }
  return sum;
}

}  // namespace

PointMap::PointMap(const PointMapConfig& config)
    : config_(config), inverse_size_(1.0 / config.voxel_size_m), voxels_(config.capacity) {
  // As many points of this spacing as a voxel may hold cover a surface through it.
  square_spacing_ =
      static_cast<float>(config.voxel_size_m * config.voxel_size_m / static_cast<double>(kPointsPerVoxel));
  const auto side = std::bit_ceil(
      static_cast<std::uint32_t>(std::ceil(2.0 * config.radius_m * inverse_size_ + kCellsOfPlay)));
  const std::uint32_t height = std::max(kMinHeight, side / kHeightShare);
  side_mask_ = side - 1;
  height_mask_ = height - 1;
  side_bits_ = static_cast<std::uint32_t>(std::countr_zero(side));
  cells_.resize(std::size_t{side} * side * height);
  clear();
}

double PointMap::spacing_m() const { return std::sqrt(static_cast<double>(square_spacing_)); }

void PointMap::clear() {
  std::fill(cells_.begin(), cells_.end(), kNoVoxel);
  for (Voxel& voxel : voxels_) voxel.count = 0;
  // The lowest index is used first.
  free_.resize(config_.capacity);
  for (std::size_t i = 0; i < free_.size(); ++i) free_[i] = static_cast<std::uint32_t>(free_.size() - 1 - i);
  size_ = 0;
  sweep_position_ = 0;
}

std::size_t PointMap::cell_of(const VoxelIndex& index) const {
  const std::size_t x = static_cast<std::uint32_t>(index.x()) & side_mask_;
  const std::size_t y = static_cast<std::uint32_t>(index.y()) & side_mask_;
  const std::size_t z = static_cast<std::uint32_t>(index.z()) & height_mask_;
  return (z << 2U * side_bits_) | (y << side_bits_) | x;
}

const PointMap::Voxel* PointMap::find(const VoxelIndex& index) const {
  const std::uint32_t slot = cells_[cell_of(index)];
  if (slot == kNoVoxel) return nullptr;
  const Voxel& voxel = voxels_[slot];
  return voxel.index == index ? &voxel : nullptr;
}

PointMap::Voxel* PointMap::find_or_create(const VoxelIndex& index) {
  std::uint32_t& slot = cells_[cell_of(index)];
  if (slot == kNoVoxel) {
    if (free_.empty()) return nullptr;
    slot = free_.back();
    free_.pop_back();
    voxels_[slot].index = index;
    ++size_;
  }
  return voxels_[slot].index == index ? &voxels_[slot] : nullptr;
}

void PointMap::insert(std::span<const Vector3> points) {
  for (const Vector3& point : points) {
    const VoxelIndex index = index_of(point);
    Voxel* voxel = find_or_create(index);
    if (voxel == nullptr) {
      ++refused_;
      continue;
    }
    if (voxel->count == kPointsPerVoxel) continue;
    const Eigen::Vector3f local = (point - index.cast<double>() * config_.voxel_size_m).cast<float>();
    const auto stored = std::span(voxel->points).first(voxel->count);
    const bool crowded = std::any_of(stored.begin(), stored.end(), [&](const Eigen::Vector3f& other) {
      return (other - local).squaredNorm() < square_spacing_;
    });
    if (!crowded) voxel->points[voxel->count++] = local;
  }
}

void PointMap::evict_far_from(const Vector3& center) {
  const std::size_t share = (voxels_.size() + kPointSweepShare - 1) / kPointSweepShare;
  const double limit = config_.radius_m * config_.radius_m;
  for (std::size_t i = 0; i < share; ++i) {
    const std::size_t slot = sweep_position_;
    sweep_position_ = (sweep_position_ + 1) % voxels_.size();
    Voxel& voxel = voxels_[slot];
    if (voxel.count == 0) continue;
    if ((voxel.index.cast<double>() * config_.voxel_size_m - center).squaredNorm() <= limit) continue;
    cells_[cell_of(voxel.index)] = kNoVoxel;
    voxel.count = 0;
    free_.push_back(static_cast<std::uint32_t>(slot));
    --size_;
  }
}

std::size_t PointMap::find_nearest(const Vector3& position, double max_distance_m,
                                   std::span<Neighbour> neighbours) const {
  static const std::array<VoxelIndex, 27> kNeighbourhood = make_neighbourhood();
  const VoxelIndex home = index_of(position);
  const Vector3 local = position - home.cast<double>() * config_.voxel_size_m;
  const double reach = std::min(max_distance_m, config_.voxel_size_m);
  std::size_t found = 0;
  double limit = reach * reach;
  for (const VoxelIndex& offset : kNeighbourhood) {
    if (square_distance_to(offset, local, config_.voxel_size_m) > limit) continue;
    const Voxel* voxel = find(home + offset);
    if (voxel == nullptr) continue;
    const Vector3 corner = (home + offset).cast<double>() * config_.voxel_size_m;
    for (std::size_t i = 0; i < voxel->count; ++i) {
      const Vector3 candidate = corner + voxel->points[i].cast<double>();
      const double square_distance = (candidate - position).squaredNorm();
      if (square_distance >= limit) continue;
      if (found < neighbours.size()) ++found;
      std::size_t place = found - 1;
      for (; place > 0 && neighbours[place - 1].square_distance > square_distance; --place)
        neighbours[place] = neighbours[place - 1];
      neighbours[place] = {candidate, square_distance};
      if (found == neighbours.size()) limit = neighbours.back().square_distance;
    }
  }
  return found;
}

}  // namespace nilio::core
