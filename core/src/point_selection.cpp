#include "nilio/core/point_selection.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace nilio::core {

namespace {

constexpr double kVerticalNormal = 0.8;    // |n_z| above: ground, floors, roofs
constexpr double kHorizontalNormal = 0.3;  // |n_z| below: walls
constexpr double kNearGroundSquare = 20.0 * 20.0;

std::size_t group_of(const Vector3& normal, double square_range) {
  const double vertical = std::abs(normal.z());
  if (vertical > kVerticalNormal) return square_range < kNearGroundSquare ? 0 : 1;
  if (vertical > kHorizontalNormal) return 6;
  // Headings modulo 180 degrees, in four sectors centred on 0, 45, 90 and 135 degrees.
  const double heading = std::atan2(normal.y(), normal.x()) / std::numbers::pi * 4.0;
  const int sector = (static_cast<int>(std::lround(heading)) + 8) % 4;
  return 2 + static_cast<std::size_t>(sector);
}

}  // namespace

PointSelector::PointSelector(std::size_t capacity) : filter_(capacity) {
  for (auto& group : groups_) group.reserve(capacity);
}

void PointSelector::select(const VoxelMap& map, std::span<const Eigen::Vector3f> positions,
                           const SE3& T_map_moving, const SelectionConfig& config,
                           std::vector<std::uint32_t>& selection) {
  for (auto& group : groups_) group.clear();
  filter_.begin(config.voxel_size_m);
  const Matrix3 R_moving_map = T_map_moving.rotation.conjugate().toRotationMatrix();
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (!filter_.insert(positions[i])) continue;
    const VoxelSurface* surface = map.find(map.index_of(T_map_moving * positions[i].cast<double>()));
    if (surface == nullptr || surface->planarity > static_cast<float>(config.max_planarity)) continue;
    const Vector3 normal = R_moving_map * surface->normal.cast<double>();
    groups_[group_of(normal, positions[i].squaredNorm())].push_back(static_cast<std::uint32_t>(i));
  }

  // Smallest group first, so that what it cannot give is shared among those still to come.
  std::array<std::size_t, kGroups> order{};
  for (std::size_t g = 0; g < kGroups; ++g) order[g] = g;
  // Ties by index: as stable_sort, which would allocate.
  std::sort(order.begin(), order.end(), [this](std::size_t a, std::size_t b) {
    return groups_[a].size() != groups_[b].size() ? groups_[a].size() < groups_[b].size() : a < b;
  });
  selection.clear();
  std::size_t remaining = config.target;
  for (std::size_t rank = 0; rank < kGroups; ++rank) {
    const auto& group = groups_[order[rank]];
    const std::size_t share = std::min(group.size(), remaining / (kGroups - rank));
    for (std::size_t k = 0; k < share; ++k) selection.push_back(group[k * group.size() / share]);
    remaining -= share;
  }
  std::sort(selection.begin(), selection.end());
}

}  // namespace nilio::core
