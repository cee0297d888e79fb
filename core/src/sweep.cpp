#include "nilio/core/sweep.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace nilio::core {

namespace {

constexpr std::uint64_t kFibonacci = 0x9E3779B97F4A7C15ULL;
// 21 bits an axis: +-500 km at 0.5 m, far outside any range gate.
constexpr std::int64_t kAxisOffset = 1 << 20;
constexpr std::uint64_t kAxisMask = (1ULL << 21U) - 1ULL;

std::uint64_t pack_key(const Eigen::Vector3f& position, float inverse_size) {
  const auto cell = [inverse_size](float value) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(value * inverse_size)) +
                                      kAxisOffset) &
           kAxisMask;
  };
  return cell(position.x()) | (cell(position.y()) << 21U) | (cell(position.z()) << 42U);
}

/// Turns a point about the horizontal axis across its direction, upwards.
Eigen::Vector3f raise_beam(const Eigen::Vector3f& p, float cosine, float sine) {
  const float horizontal = p.head<2>().norm();
  if (horizontal == 0.0F) return p;
  const float shrink = cosine - p.z() / horizontal * sine;
  return {p.x() * shrink, p.y() * shrink, p.z() * cosine + horizontal * sine};
}

}  // namespace

VoxelFilter::VoxelFilter(std::size_t capacity)
    : slots_(std::bit_ceil(2 * capacity)), mask_(slots_.size() - 1) {}

void VoxelFilter::begin(float voxel_size_m) {
  inverse_size_ = 1.0F / voxel_size_m;
  used_ = 0;
  if (++generation_ == 0) {
    for (Slot& slot : slots_) slot.generation = 0;
    generation_ = 1;
  }
}

bool VoxelFilter::insert(const Eigen::Vector3f& position) {
  const std::uint64_t key = pack_key(position, inverse_size_);
  std::size_t index = (key * kFibonacci) >> 32U & mask_;
  while (slots_[index].generation == generation_) {
    if (slots_[index].key == key) return false;
    index = (index + 1) & mask_;
  }
  if (used_ * 2 >= slots_.size()) return false;
  slots_[index] = {key, generation_};
  ++used_;
  return true;
}

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
  // KITTI's files have no numbers of beams.
  const bool numbered =
      std::any_of(scan.points.begin(), scan.points.end(), [](const Point& point) { return point.ring != 0; });
  for (const Point& point : scan.points) {
    Eigen::Vector3f p(point.x, point.y, point.z);
    const float square = p.squaredNorm();
    // Also false for NaN.
    if (!(square >= min_square && square <= max_square)) continue;
    if (!filter.insert(p)) continue;
    const float beam = numbered ? static_cast<float>(point.ring)
                                : std::atan2(p.z(), p.head<2>().norm()) / scan.beam_spacing_rad;
    if (sine != 0.0F) p = raise_beam(p, cosine, sine);
    const float time_s = static_cast<float>(static_cast<double>(point.time_offset_ns - sweep_ns) * 1e-9);
    output.push_back({R_base_lidar * p + t_base_lidar, time_s, beam});
  }
}

}  // namespace nilio::core
