#include "tools/bench/basin/trials.hpp"

#include "nilio/core/units.hpp"

#include "core/src/preprocessing/normal_space_sampling.hpp"
#include "core/src/preprocessing/scan_filter.hpp"
#include "daemon/config/convert.hpp"
#include "tools/common/progress.hpp"

#include <cmath>
#include <deque>
#include <mutex>
#include <numbers>
#include <random>

#include <tbb/parallel_for.h>

namespace nilio::tools::bench {

namespace {

using core::RegistrationMethodInfo;
using core::RegistrationResult;
using core::SE3;
using core::Vector3;

// With one scan, voxels of a 16-beam sensor have too few points.
constexpr std::size_t kMapScans = 5;
// Leaves out the start of the odometry.
constexpr std::size_t kFirstScan = 10;
constexpr std::size_t kMapCapacity = 40000;
// As in a relocalisation: the widest gate and kernel first, then those of tracking.
constexpr std::array<double, 2> kSigmasMetres = {2.0, 0.2};
constexpr double kGateSigmas = 3.0;
constexpr double kKernelSigmas = 0.5;
constexpr std::size_t kCoarsePoints = 800;
constexpr float kCoarseVoxelMetres = 1.0F;

struct StoredScan {
  std::vector<Eigen::Vector3f> points;
  SE3 T_odom_base;
};

/// Registrations against the maps of one pair.
class PairTrials {
 public:
  PairTrials(const ScanPair& pair, const core::OdometryConfig& config)
      : pair_(pair),
        config_(config),
        planes_({pair.plane_voxel_m, config.map_radius_m, kMapCapacity}),
        gaussians_({config.coarse_voxel_m, config.map_radius_m, kMapCapacity}),
        stored_({1.0, config.map_radius_m, kMapCapacity}),
        filter_(pair.points.size()),
        selector_(pair.points.size()) {
    planes_.insert(pair.map_points);
    stored_.insert(pair.map_points);
    // Downsampled like the points of the odometry's NDT map.
    core::VoxelDownsampler filter(pair.map_points.size());
    filter.begin(kCoarseVoxelMetres * 0.5F);
    std::vector<Vector3> downsampled;
    for (const Vector3& point : pair.map_points) {
      if (filter.insert((pair.T_odom_base.inverse() * point).cast<float>())) downsampled.push_back(point);
    }
    gaussians_.insert(downsampled);
    const std::size_t count = std::min(kCoarsePoints, pair.points.size());
    for (std::size_t i = 0; i < count; ++i)
      coarse_points_.push_back(pair.points[i * pair.points.size() / count]);
  }

  SE3 register_from(const RegistrationMethodInfo& method, const SE3& T_guess) {
    select(T_guess);
    SE3 pose = T_guess;
    if (method.coarse) {
      const RegistrationResult coarse =
          core::register_coarsely(gaussians_, coarse_points_, pose, config_.max_coarse_iterations);
      if (coarse.T_map_moving.is_finite()) pose = coarse.T_map_moving;
    }
    for (const double sigma : kSigmasMetres) {
      core::PlaneMetric metric;
      metric.gate_m = kGateSigmas * sigma;
      metric.kernel_scale_m = kKernelSigmas * sigma;
      core::SolverOptions options;
      options.max_iterations = config_.max_passes * config_.max_fine_iterations;
      const core::RegistrationMaps maps{&planes_, &gaussians_, &stored_};
      const RegistrationResult fine = method.refine(maps, selected_, pose, metric, options);
      if (!fine.T_map_moving.is_finite()) return pose;
      pose = fine.T_map_moving;
    }
    return pose;
  }

 private:
  /// Selects points as the odometry does: by the normals of their correspondences at the initial pose.
  void select(const SE3& T_guess) {
    const core::SelectionConfig selection{config_.registration_points, kCoarseVoxelMetres, 0.1};
    selector_.select(planes_, filter_, pair_.points, T_guess, selection, indices_);
    selected_.clear();
    for (const std::uint32_t index : indices_) selected_.push_back(pair_.points[index]);
  }

  const ScanPair& pair_;
  const core::OdometryConfig& config_;
  core::VoxelMap planes_;
  core::VoxelMap gaussians_;
  core::PointMap stored_;
  core::VoxelDownsampler filter_;
  core::NormalSpaceSampler selector_;
  std::vector<Eigen::Vector3f> coarse_points_;
  std::vector<Eigen::Vector3f> selected_;
  std::vector<std::uint32_t> indices_;
};

bool is_near(const SE3& a, const SE3& b, double metres, double degrees) {
  const SE3 difference = a.inverse() * b;
  return difference.translation.norm() < metres &&
         core::so3_log(difference.rotation).norm() < degrees * kRadiansPerDegree;
}

SE3 make_offset(const BasinOffset& offset, std::mt19937_64& random) {
  std::uniform_real_distribution<double> heading(-std::numbers::pi, std::numbers::pi);
  const double direction = heading(random);
  const double side = heading(random) < 0.0 ? -1.0 : 1.0;
  const double angle = side * offset.rotation_deg * kRadiansPerDegree;
  return {Eigen::Quaterniond(Eigen::AngleAxisd(angle, Vector3::UnitZ())),
          offset.translation_m * Vector3(std::cos(direction), std::sin(direction), 0.0)};
}

/// Successes, [method * number of offsets + offset].
std::vector<bool> try_pair(std::span<const RegistrationMethodInfo> methods, const ScanPair& pair,
                           std::span<const BasinOffset> offsets, const core::OdometryConfig& config,
                           std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::vector<SE3> guesses;
  for (const BasinOffset& offset : offsets) guesses.push_back(pair.T_odom_base * make_offset(offset, random));
  PairTrials trials(pair, config);
  std::vector<bool> success;
  for (const RegistrationMethodInfo& method : methods) {
    const SE3 result = trials.register_from(method, pair.T_odom_base);
    const bool is_right = is_near(result, pair.T_odom_base, kBasinTruthMetres, kBasinTruthDegrees);
    for (const SE3& guess : guesses) {
      success.push_back(is_right &&
                        is_near(trials.register_from(method, guess), result, kBasinMetres, kBasinDegrees));
    }
  }
  return success;
}

}  // namespace

core::Result<std::vector<ScanPair>> collect_pairs(const BenchDataset& dataset, const daemon::Config& config,
                                                  std::size_t count) {
  std::size_t scans = 0;
  const auto first =
      run_odometry(dataset, config, nullptr,
                   [&](const core::Scan&, const core::OdometryResult&, const core::Odometry&) { ++scans; });
  if (!first) return first.error();
  if (scans <= kFirstScan)
    return core::Error{dataset.name + ": has only " + std::to_string(scans) + " scans, needs more than " +
                       std::to_string(kFirstScan)};
  const std::size_t usable = scans - kFirstScan;
  count = std::min(count, usable);
  std::vector<ScanPair> pairs;
  std::deque<StoredScan> recent;
  std::size_t index = 0;
  const core::OdometryConfig odometry_config = daemon::odometry_config(config);
  const auto second = run_odometry(
      dataset, config, nullptr,
      [&](const core::Scan& scan, const core::OdometryResult& result, const core::Odometry& odometry) {
        const std::size_t wanted = kFirstScan + pairs.size() * usable / count;
        if (index == wanted && pairs.size() < count) {
          ScanPair pair;
          pair.points = odometry.deskewed_points();
          pair.T_odom_base = result.T_odom_base;
          pair.plane_voxel_m = core::plane_voxel_for(odometry_config, scan.beam_spacing_rad);
          for (const StoredScan& stored : recent) {
            for (const Eigen::Vector3f& point : stored.points)
              pair.map_points.push_back(stored.T_odom_base * point.cast<double>());
          }
          pairs.push_back(std::move(pair));
        }
        ++index;
        recent.push_back({odometry.deskewed_points(), result.T_odom_base});
        if (recent.size() > kMapScans) recent.pop_front();
      });
  if (!second) return second.error();
  return pairs;
}

std::vector<std::vector<std::size_t>> count_successes(std::span<const RegistrationMethodInfo> methods,
                                                      std::span<const ScanPair> pairs,
                                                      std::span<const BasinOffset> offsets,
                                                      const core::OdometryConfig& config,
                                                      std::uint64_t seed) {
  std::vector<std::vector<bool>> success(pairs.size());
  Progress progress("registering pairs", pairs.size());
  std::mutex progress_mutex;
  std::size_t done = 0;
  tbb::parallel_for(std::size_t{0}, pairs.size(), [&](std::size_t i) {
    success[i] = try_pair(methods, pairs[i], offsets, config, seed + i);
    const std::lock_guard lock(progress_mutex);
    progress.update(++done);
  });
  std::vector<std::vector<std::size_t>> counts(methods.size(), std::vector<std::size_t>(offsets.size(), 0));
  for (const std::vector<bool>& of_pair : success) {
    for (std::size_t k = 0; k < of_pair.size(); ++k)
      counts[k / offsets.size()][k % offsets.size()] += of_pair[k] ? 1 : 0;
  }
  return counts;
}

}  // namespace nilio::tools::bench
