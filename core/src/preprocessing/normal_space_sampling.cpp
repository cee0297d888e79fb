#include "core/src/preprocessing/normal_space_sampling.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace nilio::core {

namespace {

constexpr float kVerticalNormal = 0.8F;    // |n_z| above: ground, floors, roofs
constexpr float kHorizontalNormal = 0.3F;  // |n_z| below: walls
constexpr float kNearGroundSquare = 20.0F * 20.0F;
constexpr float kTangentOfHalfSector = 0.41421356F;  // 22.5 deg
constexpr std::size_t kGaussianGroup = 7;            // no plane

std::size_t group_of(const Eigen::Vector3f& normal, float square_range) {
  const float vertical = std::abs(normal.z());
  if (vertical > kVerticalNormal) return square_range < kNearGroundSquare ? 0 : 1;
  if (vertical > kHorizontalNormal) return 6;
  // Headings modulo 180 degrees, in four sectors centred on 0, 45, 90 and 135 degrees.
  const float along = std::abs(normal.x());
  const float across = std::abs(normal.y());
  if (across < kTangentOfHalfSector * along) return 2;
  if (along < kTangentOfHalfSector * across) return 4;
  return normal.x() * normal.y() > 0.0F ? 3 : 5;
}

}  // namespace

void sample_evenly(const std::vector<Eigen::Vector3f>& points, std::size_t target,
                   std::vector<Eigen::Vector3f>& output) {
  output.clear();
  const std::size_t count = std::min(target, points.size());
  for (std::size_t i = 0; i < count; ++i) output.push_back(points[i * points.size() / count]);
}

NormalSpaceSampler::NormalSpaceSampler(std::size_t capacity) {
  candidates_.reserve(capacity);
  for (auto& group : groups_) group.reserve(capacity);
}

void NormalSpaceSampler::select(const VoxelMap& map, VoxelDownsampler& filter,
                                std::span<const Eigen::Vector3f> positions, const SE3& T_map_moving,
                                const SelectionConfig& config, std::vector<std::uint32_t>& selection) {
  for (auto& group : groups_) group.clear();
  filter.begin(config.voxel_size_m);
  candidates_.clear();
  const auto position_of = [&](std::size_t i, Eigen::Vector3f& position) {
    position = positions[i];
    return true;
  };
  filter.thin(positions.size(), position_of,
              [&](std::size_t i) { candidates_.push_back(static_cast<std::uint32_t>(i)); });
  sort_candidates(map, positions, T_map_moving, config.max_planarity);

  // Smallest group first; its unused share goes to the others.
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

void NormalSpaceSampler::sort_candidates(const VoxelMap& map, std::span<const Eigen::Vector3f> positions,
                                         const SE3& T_map_moving, double max_planarity) {
  constexpr std::size_t kBlock = 32;
  const auto limit = static_cast<float>(max_planarity);
  const Matrix3 R = T_map_moving.rotation.toRotationMatrix();
  const Eigen::Matrix3f R_moving_map = R.transpose().cast<float>();
  std::array<VoxelIndex, kBlock> indices;
  std::array<const GaussianVoxel*, kBlock> surfaces;
  for (std::size_t begin = 0; begin < candidates_.size(); begin += kBlock) {
    const std::size_t count = std::min(kBlock, candidates_.size() - begin);
    for (std::size_t k = 0; k < count; ++k) {
      const Vector3 p = positions[candidates_[begin + k]].cast<double>();
      indices[k] = map.index_of(R * p + T_map_moving.translation);
    }
    map.find_all(indices, count, surfaces);
    for (std::size_t k = 0; k < count; ++k) {
      if (surfaces[k] == nullptr || !surfaces[k]->has_shape()) continue;
      const std::uint32_t i = candidates_[begin + k];
      const bool has_plane = surfaces[k]->planarity <= limit;
      const std::size_t group =
          !has_plane ? kGaussianGroup
                     : group_of(R_moving_map * surfaces[k]->normal, positions[i].squaredNorm());
      groups_[group].push_back(i);
    }
  }
}

}  // namespace nilio::core
