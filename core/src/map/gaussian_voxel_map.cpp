#include "core/src/map/gaussian_voxel_map.hpp"

#include "core/src/linear_algebra.hpp"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

namespace nilio::core {

namespace {

// Share of the slab that eviction visits per scan.
constexpr std::size_t kSweepShare = 10;
// Eigenvalues below this share of the largest are raised to it (Magnusson 2009, section 6.2.1); no surface is
// thinner than the range noise.
constexpr double kEigenvalueRatioFloor = 0.01;
constexpr double kEigenvalueFloor = 0.02 * 0.02;
// Minimum spread of points across a scan line, as a share of the voxel: points of one line have no normal.
constexpr double kMinSpreadShare = 0.05;

void count_scan(GaussianVoxel& surface) {
  if (surface.scans < std::numeric_limits<std::uint16_t>::max()) ++surface.scans;
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

void VoxelMap::reset(double voxel_size_m) {
  config_.voxel_size_m = voxel_size_m;
  inverse_size_ = 1.0 / voxel_size_m;
  // Only used voxels are cleared: a reset must not cost the whole slab.
  for (std::uint32_t voxel = 0; voxel < used_; ++voxel) {
    if (!moments_[voxel].occupied) continue;
    std::size_t slot = home_slot(moments_[voxel].key);
    while (slots_[slot].voxel != voxel) slot = (slot + 1) & mask_;
    slots_[slot] = Slot{};
    moments_[voxel].occupied = false;
  }
  // The lowest index is used first.
  free_.resize(config_.capacity);
  for (std::size_t i = 0; i < free_.size(); ++i) free_[i] = static_cast<std::uint32_t>(free_.size() - 1 - i);
  used_ = 0;
  size_ = 0;
  sweep_position_ = 0;
}

std::uint32_t VoxelMap::find_or_create(std::uint64_t key) {
  Slot& slot = slots_[find_slot(key)];
  if (slot.voxel != kNoVoxel) return slot.voxel;
  if (free_.empty()) {
    ++refused_;
    return kNoVoxel;
  }
  const std::uint32_t voxel = free_.back();
  free_.pop_back();
  used_ = std::max(used_, voxel + 1);
  slot = {static_cast<std::uint32_t>(key), voxel};
  moments_[voxel] = Moments{};
  moments_[voxel].key = key;
  moments_[voxel].occupied = true;
  moments_[voxel].refresh_at = static_cast<std::uint16_t>(config_.min_points);
  surfaces_[voxel] = GaussianVoxel{};
  surfaces_[voxel].key_high = static_cast<std::uint32_t>(key >> 32U);
  ++size_;
  return voxel;
}

void VoxelMap::erase(std::uint32_t voxel) {
  std::size_t hole = find_slot(moments_[voxel].key);
  // Backward-shift deletion: no tombstones, so look-ups never grow longer with age.
  for (std::size_t next = (hole + 1) & mask_; slots_[next].voxel != kNoVoxel; next = (next + 1) & mask_) {
    const std::size_t home = home_slot(moments_[slots_[next].voxel].key);
    if (((next - home) & mask_) >= ((next - hole) & mask_)) {
      slots_[hole] = slots_[next];
      hole = next;
    }
  }
  slots_[hole] = Slot{};
  moments_[voxel].occupied = false;
  surfaces_[voxel].count = 0;
  free_.push_back(voxel);
  --size_;
}

void VoxelMap::insert(std::span<const Vector3> points, std::span<const float> beams) {
  scan_ = static_cast<std::uint16_t>(std::max(1, (scan_ + 1) & 0xFFFF));
  // Blocks, with the memory of the next one prefetched.
  constexpr std::size_t kBlock = 32;
  std::array<std::uint64_t, kBlock> keys;
  std::array<std::uint32_t, kBlock> voxels;
  std::array<Eigen::Vector3f, kBlock> local;
  for (std::size_t begin = 0; begin < points.size(); begin += kBlock) {
    const std::size_t count = std::min(kBlock, points.size() - begin);
    for (std::size_t k = 0; k < count; ++k) {
      const Vector3 cell = points[begin + k] * inverse_size_;
      const VoxelIndex index = index_of(points[begin + k]);
      local[k] = (cell - index.cast<double>() - Vector3::Constant(0.5)).cast<float>();
      keys[k] = pack_key(index);
      __builtin_prefetch(&slots_[home_slot(keys[k])]);
    }
    for (std::size_t k = 0; k < count; ++k) {
      voxels[k] = find_or_create(keys[k]);
      if (voxels[k] != kNoVoxel) __builtin_prefetch(&moments_[voxels[k]], 1);
    }
    for (std::size_t k = 0; k < count; ++k) {
      if (voxels[k] != kNoVoxel) add(voxels[k], local[k], beams.empty() ? 0.0F : beams[begin + k]);
    }
  }
}

void VoxelMap::add(std::uint32_t voxel, const Eigen::Vector3f& local, float beam) {
  Moments& m = moments_[voxel];
  if (m.count == 0) m.min_beam = m.max_beam = beam;
  const bool one_beam = !seen_by_several_beams(m);
  m.min_beam = std::min(m.min_beam, beam);
  m.max_beam = std::max(m.max_beam, beam);
  if (m.count >= config_.max_points) {
    const std::uint16_t half = m.count / 2;
    const float kept = static_cast<float>(half) / static_cast<float>(m.count);
    for (float& sum : m.sum) sum *= kept;
    for (float& product : m.products) product *= kept;
    m.count = half;
    m.refresh_at = static_cast<std::uint16_t>(half + half / 2);
  }
  ++m.count;
  if (std::exchange(m.last_scan, scan_) != scan_) count_scan(surfaces_[voxel]);
  for (int axis = 0; axis < 3; ++axis) m.sum[axis] += local[axis];
  m.products[0] += local.x() * local.x();
  m.products[1] += local.x() * local.y();
  m.products[2] += local.x() * local.z();
  m.products[3] += local.y() * local.y();
  m.products[4] += local.y() * local.z();
  m.products[5] += local.z() * local.z();
  // The first point of a second beam completes a plane.
  if (one_beam && seen_by_several_beams(m))
    m.refresh_at = std::max(static_cast<std::uint16_t>(config_.min_points), m.count);
  if (m.count >= m.refresh_at) refresh(voxel);
}

void VoxelMap::refresh(std::uint32_t voxel) {
  Moments& m = moments_[voxel];
  // The Gaussian is solved again at half again as many points: as accurate and far cheaper than at every
  // point.
  m.refresh_at =
      static_cast<std::uint16_t>(std::min<std::uint32_t>(config_.max_points, m.count + (m.count + 1U) / 2U));
  const double inverse_count = 1.0 / m.count;
  const Vector3 mean = Vector3(m.sum[0], m.sum[1], m.sum[2]) * inverse_count;
  Matrix3 covariance;
  covariance << m.products[0], m.products[1], m.products[2], m.products[1], m.products[3], m.products[4],
      m.products[2], m.products[4], m.products[5];
  covariance = covariance * inverse_count - mean * mean.transpose();
  covariance *= config_.voxel_size_m * config_.voxel_size_m;
  const auto [eigenvalues, axes] = symmetric_eigen(covariance);
  const Vector3 values = eigenvalues.cwiseMax(0.0);
  const double floor = std::max(kEigenvalueFloor, kEigenvalueRatioFloor * values[2]);
  const Vector3 inverse = values.cwiseMax(floor).cwiseInverse();
  const Matrix3 information = axes * inverse.asDiagonal() * axes.transpose();

  GaussianVoxel& surface = surfaces_[voxel];
  surface.mean = ((mean + Vector3::Constant(0.5)) * config_.voxel_size_m).cast<float>();
  surface.normal = axes.col(0).cast<float>();
  surface.information[0] = static_cast<float>(information(0, 0));
  surface.information[1] = static_cast<float>(information(0, 1));
  surface.information[2] = static_cast<float>(information(0, 2));
  surface.information[3] = static_cast<float>(information(1, 1));
  surface.information[4] = static_cast<float>(information(1, 2));
  surface.information[5] = static_cast<float>(information(2, 2));
  const double min_spread = kMinSpreadShare * config_.voxel_size_m;
  const bool has_shape = values[1] > min_spread * min_spread && seen_by_several_beams(m);
  surface.planarity = static_cast<float>(has_shape ? values[0] / values[1] : 2.0);
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
