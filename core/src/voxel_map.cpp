#include "nilio/core/voxel_map.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include <Eigen/Eigenvalues>

namespace nilio::core {

namespace {

constexpr std::uint64_t kFibonacci = 0x9E3779B97F4A7C15ULL;
constexpr std::uint32_t kNoVoxel = 0xFFFFFFFFU;
// 21 bits an axis: +-1048 km at 1 m. Positions outside wrap onto a voxel that eviction has emptied long ago.
constexpr std::int64_t kAxisOffset = 1 << 20;
constexpr std::uint64_t kAxisMask = (1ULL << 21U) - 1ULL;
// Share of the slab that eviction looks at per scan.
constexpr std::size_t kSweepShare = 10;
// Covariance eigenvalues below this share of the largest are raised to it (Magnusson 2009, section 6.2.1),
// and no surface is taken to be thinner than the sensor's range noise.
constexpr double kEigenvalueRatioFloor = 0.01;
constexpr double kEigenvalueFloor = 0.02 * 0.02;
// A piece of one scan line has no normal: its points must spread across the line, too, by this share of the
// voxel.
constexpr double kMinSpreadShare = 0.05;

std::uint64_t pack_key(const VoxelIndex& index) {
  const auto axis = [](int value) { return static_cast<std::uint64_t>(value + kAxisOffset) & kAxisMask; };
  return axis(index.x()) | (axis(index.y()) << 21U) | (axis(index.z()) << 42U);
}

VoxelIndex unpack_key(std::uint64_t key) {
  const auto axis = [](std::uint64_t bits) {
    return static_cast<int>(static_cast<std::int64_t>(bits & kAxisMask) - kAxisOffset);
  };
  return {axis(key), axis(key >> 21U), axis(key >> 42U)};
}

}  // namespace

VoxelMap::VoxelMap(const VoxelMapConfig& config)
    : config_(config),
      inverse_size_(1.0 / config.voxel_size_m),
      surfaces_(config.capacity),
      moments_(config.capacity),
      slots_(std::bit_ceil(2 * config.capacity)),
      free_(config.capacity),
      mask_(slots_.size() - 1) {
  clear();
}

void VoxelMap::clear() {
  std::fill(surfaces_.begin(), surfaces_.end(), VoxelSurface{});
  std::fill(moments_.begin(), moments_.end(), Moments{});
  std::fill(slots_.begin(), slots_.end(), Slot{});
  // The lowest index is handed out first.
  free_.resize(config_.capacity);
  for (std::size_t i = 0; i < free_.size(); ++i) free_[i] = static_cast<std::uint32_t>(free_.size() - 1 - i);
  size_ = 0;
  sweep_position_ = 0;
}

std::size_t VoxelMap::home_slot(std::uint64_t key) const { return (key * kFibonacci) >> 32U & mask_; }

std::size_t VoxelMap::find_slot(std::uint64_t key) const {
  std::size_t slot = home_slot(key);
  while (slots_[slot].occupied && slots_[slot].key != key) slot = (slot + 1) & mask_;
  return slot;
}

const VoxelSurface* VoxelMap::find(const VoxelIndex& index) const {
  const Slot& slot = slots_[find_slot(pack_key(index))];
  if (!slot.occupied) return nullptr;
  const VoxelSurface& surface = surfaces_[slot.voxel];
  return surface.count > 0 ? &surface : nullptr;
}

std::uint32_t VoxelMap::find_or_create(std::uint64_t key) {
  Slot& slot = slots_[find_slot(key)];
  if (slot.occupied) return slot.voxel;
  if (free_.empty()) {
    ++refused_;
    return kNoVoxel;
  }
  const std::uint32_t voxel = free_.back();
  free_.pop_back();
  slot = {key, voxel, true};
  moments_[voxel] = Moments{};
  moments_[voxel].key = key;
  moments_[voxel].occupied = true;
  moments_[voxel].refresh_at = config_.min_points;
  surfaces_[voxel] = VoxelSurface{};
  ++size_;
  return voxel;
}

void VoxelMap::erase(std::uint32_t voxel) {
  std::size_t hole = find_slot(moments_[voxel].key);
  // Backward-shift deletion: no tombstones, so look-ups never grow longer with age.
  for (std::size_t next = (hole + 1) & mask_; slots_[next].occupied; next = (next + 1) & mask_) {
    const std::size_t home = home_slot(slots_[next].key);
    if (((next - home) & mask_) >= ((next - hole) & mask_)) {
      slots_[hole] = slots_[next];
      hole = next;
    }
  }
  slots_[hole].occupied = false;
  moments_[voxel].occupied = false;
  surfaces_[voxel].count = 0;
  free_.push_back(voxel);
  --size_;
}

void VoxelMap::insert(std::span<const Vector3> points, std::span<const float> beams) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    const VoxelIndex index = index_of(points[i]);
    const std::uint32_t voxel = find_or_create(pack_key(index));
    if (voxel == kNoVoxel) continue;
    add(voxel, points[i] - corner_of(index), beams.empty() ? 0.0F : beams[i]);
  }
}

void VoxelMap::add(std::uint32_t voxel, const Vector3& local, float beam) {
  Moments& m = moments_[voxel];
  if (m.count == 0) m.min_beam = m.max_beam = beam;
  const bool one_beam = !seen_by_several_beams(m);
  m.min_beam = std::min(m.min_beam, beam);
  m.max_beam = std::max(m.max_beam, beam);
  if (m.count >= config_.max_points) {
    m.count /= 2;
    m.sum *= 0.5;
    for (double& product : m.products) product *= 0.5;
    m.refresh_at = m.count + m.count / 2;
  }
  ++m.count;
  m.sum += local;
  m.products[0] += local.x() * local.x();
  m.products[1] += local.x() * local.y();
  m.products[2] += local.x() * local.z();
  m.products[3] += local.y() * local.y();
  m.products[4] += local.y() * local.z();
  m.products[5] += local.z() * local.z();
  // The point of the second beam makes a plane of what was none.
  if (one_beam && seen_by_several_beams(m)) m.refresh_at = std::max(config_.min_points, m.count);
  if (m.count >= m.refresh_at) refresh(voxel);
}

void VoxelMap::refresh(std::uint32_t voxel) {
  Moments& m = moments_[voxel];
  // The surface changes little with each point: solving at every half again as many is as good and far
  // cheaper.
  m.refresh_at = std::min(config_.max_points, m.count + (m.count + 1) / 2);
  const double inverse_count = 1.0 / m.count;
  const Vector3 mean = m.sum * inverse_count;
  Matrix3 covariance;
  covariance << m.products[0], m.products[1], m.products[2], m.products[1], m.products[3], m.products[4],
      m.products[2], m.products[4], m.products[5];
  covariance = covariance * inverse_count - mean * mean.transpose();
  Eigen::SelfAdjointEigenSolver<Matrix3> solver;
  solver.computeDirect(covariance);
  const Vector3 values = solver.eigenvalues().cwiseMax(0.0);
  const double floor = std::max(kEigenvalueFloor, kEigenvalueRatioFloor * values[2]);
  const Vector3 inverse = values.cwiseMax(floor).cwiseInverse();
  const Matrix3& axes = solver.eigenvectors();
  const Matrix3 information = axes * inverse.asDiagonal() * axes.transpose();

  VoxelSurface& surface = surfaces_[voxel];
  surface.mean = mean.cast<float>();
  surface.normal = axes.col(0).cast<float>();
  surface.information[0] = static_cast<float>(information(0, 0));
  surface.information[1] = static_cast<float>(information(0, 1));
  surface.information[2] = static_cast<float>(information(0, 2));
  surface.information[3] = static_cast<float>(information(1, 1));
  surface.information[4] = static_cast<float>(information(1, 2));
  surface.information[5] = static_cast<float>(information(2, 2));
  const double min_spread = kMinSpreadShare * config_.voxel_size_m;
  const bool has_normal = values[1] > min_spread * min_spread && seen_by_several_beams(m);
  surface.planarity = static_cast<float>(has_normal ? values[0] / values[1] : 2.0);
  surface.thickness = static_cast<float>(values[0]);
  surface.count = m.count;
}

void VoxelMap::evict_far_from(const Vector3& center) {
  const std::size_t share = (moments_.size() + kSweepShare - 1) / kSweepShare;
  const double limit = config_.radius_m * config_.radius_m;
  for (std::size_t i = 0; i < share; ++i) {
    const auto voxel = static_cast<std::uint32_t>(sweep_position_);
    sweep_position_ = (sweep_position_ + 1) % moments_.size();
    if (!moments_[voxel].occupied) continue;
    const Vector3 corner = corner_of(unpack_key(moments_[voxel].key));
    if ((corner - center).squaredNorm() > limit) erase(voxel);
  }
}

}  // namespace nilio::core
