#include "mapping/submap_builder.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace nilio::mapping {

namespace {

// Longest interval between two keyframes that counts as time in motion: a stationary vehicle has none.
constexpr double kMaxIntervalSeconds = 2.0;
// Index of the last keyframe that a stored surface can refer to.
constexpr std::size_t kMaxKeyframes = 256;
// Origins lie on the grid of the irregular voxels, which the plane voxels divide.
constexpr int kVoxelsPerOriginStep = 2;

std::array<float, 21> upper_triangle(const core::Matrix6& matrix) {
  std::array<float, 21> values{};
  std::size_t i = 0;
  for (int row = 0; row < 6; ++row) {
    for (int column = row; column < 6; ++column) values[i++] = static_cast<float>(matrix(row, column));
  }
  return values;
}

Eigen::Vector3i origin_for(const core::Vector3& position) {
  const double step = kVoxelsPerOriginStep * static_cast<double>(kPlaneVoxelMetres);
  return (position / step).array().round().cast<int>() * kVoxelsPerOriginStep;
}

core::Vector3 metres(const Eigen::Vector3i& voxel) {
  return voxel.cast<double>() * static_cast<double>(kPlaneVoxelMetres);
}

}  // namespace

SubmapBuilder::SubmapBuilder(const SubmapConfig& config, Complete complete, std::uint32_t first_id)
    : config_(config), complete_(std::move(complete)), first_open_(first_id), stretch_(first_id) {}

void SubmapBuilder::continue_after(const Submap& previous) {
  const Eigen::Vector3i origin = origin_for(previous.T_odom_submap.translation);
  // The plane voxels behind an irregular one are not in the file; its points may be stored twice.
  for (const Surface& surface : previous.surfaces) {
    if (surface.is_plane) stored_.emplace_back(origin + index_at(surface.mean, kPlaneVoxelMetres));
  }
}

void SubmapBuilder::begin_stretch(const core::SE3& T_odom_base) {
  // The stretch completes the submap that has both of its stretches and a neighbour with both.
  while (open_.size() > 2) complete_oldest();
  Open open;
  open.submap.id = stretch_;
  open.origin_voxel = origin_for(T_odom_base.translation);
  open.submap.T_odom_submap.translation = metres(open.origin_voxel);
  open.grid = std::make_unique<SurfaceGrid>(config_.max_voxels);
  open_.push_back(std::move(open));
  stretch_is_over_ = false;
  stretch_m_ = 0.0;
  stretch_s_ = 0.0;
}

std::uint32_t SubmapBuilder::add(const Keyframe& keyframe) {
  if (stretch_is_over_)
    begin_stretch(keyframe.T_odom_base);
  else if (T_odom_last_) {
    stretch_m_ += (keyframe.T_odom_base.translation - T_odom_last_->translation).norm();
    stretch_s_ += std::clamp((keyframe.stamp - last_stamp_).seconds(), 0.0, kMaxIntervalSeconds);
  }
  T_odom_last_ = keyframe.T_odom_base;
  last_stamp_ = keyframe.stamp;
  const std::uint32_t stretch = stretch_;
  for (Open& open : open_) {
    if (open.submap.id == stretch || open.submap.id + 1 == stretch) add_to(open, keyframe);
  }
  const bool is_full = open_.back().submap.keyframes.size() >= kMaxKeyframes / 2;
  if (stretch_m_ >= 0.5 * config_.length_m || stretch_s_ >= 0.5 * config_.duration_s || is_full) {
    stretch_is_over_ = true;
    ++stretch_;
  }
  return stretch;
}

void SubmapBuilder::add_to(Open& open, const Keyframe& keyframe) const {
  Submap& submap = open.submap;
  const core::SE3 T_submap_base = submap.T_odom_submap.inverse() * keyframe.T_odom_base;
  const auto index = static_cast<std::uint16_t>(submap.keyframes.size());
  submap.keyframes.push_back({keyframe.stamp, T_submap_base, upper_triangle(keyframe.covariance)});
  const Eigen::Matrix3f R = T_submap_base.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = T_submap_base.translation.cast<float>();
  const auto range = static_cast<float>(config_.range_m);
  for (const MapPoint& point : keyframe.points) {
    if (point.position.squaredNorm() > range * range) continue;
    open.grid->add(R * point.position + t, point.intensity, t, index);
  }
}

Submap SubmapBuilder::freeze(const Open& open) {
  Submap submap = open.submap;
  submap.surfaces = open.grid->surfaces();
  for (std::size_t i = 0; i < submap.surfaces.size(); ++i) {
    const Eigen::Vector3f& mean = submap.surfaces[i].mean;
    submap.minimum = i == 0 ? mean : Eigen::Vector3f(submap.minimum.cwiseMin(mean));
    submap.maximum = i == 0 ? mean : Eigen::Vector3f(submap.maximum.cwiseMax(mean));
  }
  return submap;
}

/// Decides for each voxel that both have seen which of the two stores it.
void SubmapBuilder::divide(Open& oldest, Open& successor) const {
  for (auto& [key, sums] : oldest.grid->voxels()) {
    const std::optional<VoxelKey> other =
        key_of(index_of(key) + oldest.origin_voxel - successor.origin_voxel);
    VoxelSums* const theirs = other ? successor.grid->find(*other) : nullptr;
    if (theirs == nullptr) continue;
    (theirs->points >= sums.points ? sums : *theirs).is_elsewhere = true;
  }
}

void SubmapBuilder::complete_oldest() {
  Open& oldest = open_.front();
  for (const Eigen::Vector3i& voxel : std::exchange(stored_, {})) {
    const std::optional<VoxelKey> key = key_of(voxel - oldest.origin_voxel);
    if (VoxelSums* const sums = key ? oldest.grid->find(*key) : nullptr) sums->is_elsewhere = true;
  }
  if (open_.size() > 1) divide(oldest, open_[1]);
  const Submap submap = freeze(oldest);
  refused_ += oldest.grid->refused();
  open_.erase(open_.begin());
  first_open_ = submap.id + 1;
  complete_(submap);
}

void SubmapBuilder::finish() {
  while (!open_.empty()) complete_oldest();
  if (!stretch_is_over_) ++stretch_;
  stretch_is_over_ = true;
}

std::optional<Submap> SubmapBuilder::local_map() const {
  if (open_.empty()) return std::nullopt;
  return freeze(open_[open_.size() > 1 ? open_.size() - 2 : 0]);
}

}  // namespace nilio::mapping
