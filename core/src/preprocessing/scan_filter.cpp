#include "core/src/preprocessing/scan_filter.hpp"

#include "nilio/core/portable_math.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace nilio::core {

namespace {

/// Rotates a point upwards about the horizontal axis across its direction.
Eigen::Vector3f raise_beam(const Eigen::Vector3f& p, float cosine, float sine) {
  const float horizontal = p.head<2>().norm();
  if (horizontal == 0.0F) return p;
  const float shrink = cosine - p.z() / horizontal * sine;
  return {p.x() * shrink, p.y() * shrink, p.z() * cosine + horizontal * sine};
}

/// Visits points in multiples of the golden ratio, so that any prefix is spread evenly over the scan. In
/// firing order the first point of a voxel always lies on the side that the beams come from, which biases
/// walls; a stride would pick the same beams from every firing.
class SpreadOrder {
 public:
  /// `count` is at least 1.
  explicit SpreadOrder(std::size_t count) : count_(count), step_(step_for(count)) {}

  /// The next index; each one once.
  std::size_t next() {
    const std::size_t index = next_;
    next_ += step_;
    if (next_ >= count_) next_ -= count_;
    return index;
  }

 private:
  static std::size_t step_for(std::size_t count) {
    constexpr double golden_ratio = 0.6180339887498949;
    auto step = static_cast<std::size_t>(golden_ratio * static_cast<double>(count));
    while (step > 1 && std::gcd(step, count) != 1) --step;
    return std::max<std::size_t>(step, 1);
  }

  std::size_t count_;
  std::size_t step_;
  std::size_t next_ = 0;
};

constexpr std::size_t kFetchedAhead = 64;

}  // namespace

void filter_scan(const Scan& scan, const ScanFilterConfig& config, const SE3& T_base_lidar,
                 const BeamCalibration& calibration, VoxelDownsampler& filter,
                 std::vector<SweepPoint>& output) {
  output.clear();
  if (scan.points.empty()) return;
  filter.begin(config.voxel_size_m);
  const float min_square = config.min_range_m * config.min_range_m;
  const float max_square = config.max_range_m * config.max_range_m;
  const Eigen::Matrix3f R_base_lidar = T_base_lidar.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t_base_lidar = T_base_lidar.translation.cast<float>();
  const auto sweep_ns = (scan.end - scan.start).ns;
  const auto cosine = static_cast<float>(portable::cos(config.elevation_correction_rad));
  const auto sine = static_cast<float>(portable::sin(config.elevation_correction_rad));
  // KITTI files carry no beam numbers; the sine of the elevation identifies beams as well.
  const bool numbered =
      std::any_of(scan.points.begin(), scan.points.end(), [](const Point& point) { return point.ring != 0; });
  SpreadOrder order(scan.points.size());
  // Prefetching: the order is unpredictable for the hardware.
  SpreadOrder motion_prior = order;
  for (std::size_t i = 0; i < kFetchedAhead; ++i) motion_prior.next();
  const auto next_index = [&](std::size_t) {
    __builtin_prefetch(&scan.points[motion_prior.next()]);
    return order.next();
  };
  const auto position_of = [&](std::size_t i, Eigen::Vector3f& p) {
    const Point& point = scan.points[i];
    p = {point.x, point.y, point.z};
    const float square = p.squaredNorm();
    // Also false for NaN.
    return square >= min_square && square <= max_square;
  };
  filter.thin(std::min(config.max_points, scan.points.size()), next_index, position_of, [&](std::size_t i) {
    const Point& point = scan.points[i];
    Eigen::Vector3f p(point.x, point.y, point.z);
    const float beam = numbered ? static_cast<float>(point.ring) : p.z() / p.norm() / scan.beam_spacing_rad;
    if (sine != 0.0F) p = raise_beam(p, cosine, sine);
    if (numbered) p = calibration.correct(p, beam);
    const float time_s = static_cast<float>(static_cast<double>(point.time_offset_ns - sweep_ns) * 1e-9);
    output.push_back({R_base_lidar * p + t_base_lidar, time_s, beam, point.intensity});
  });
}

}  // namespace nilio::core
