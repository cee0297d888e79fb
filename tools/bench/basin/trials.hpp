#pragma once

#include "nilio/core/odometry.hpp"
#include "nilio/core/result.hpp"

#include "core/src/registration/methods.hpp"
#include "tools/bench/odometry/run.hpp"

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace nilio::tools::bench {

/// A scan and the map of the five scans before it, deskewed, at the poses of the odometry.
struct ScanPair {
  std::vector<core::Vector3> map_points;  ///< in the odometry's frame
  std::vector<Eigen::Vector3f> points;    ///< of the scan, in base_link
  core::SE3 T_odom_base;                  ///< of the scan
  double plane_voxel_m = 1.0;
};

/// Runs the odometry over the data set and takes `count` evenly spaced pairs, or all where there are fewer
/// scans.
core::Result<std::vector<ScanPair>> collect_pairs(const BenchDataset& dataset, const daemon::Config& config,
                                                  std::size_t count);

/// Error of the initial pose: a translation in a random horizontal direction and a turn to a random side.
struct BasinOffset {
  double translation_m = 0.0;
  double rotation_deg = 0.0;
};

/// Limits of a success: distance from the method's result when it starts at the odometry's pose, and of that
/// result from the odometry's pose.
inline constexpr double kBasinMetres = 0.1;
inline constexpr double kBasinDegrees = 0.5;
inline constexpr double kBasinTruthMetres = 0.3;
inline constexpr double kBasinTruthDegrees = 1.0;

/// Number of successes, [method][offset]. Directions are drawn from `seed` for each pair and are the same for
/// every method.
std::vector<std::vector<std::size_t>> count_successes(std::span<const core::RegistrationMethodInfo> methods,
                                                      std::span<const ScanPair> pairs,
                                                      std::span<const BasinOffset> offsets,
                                                      const core::OdometryConfig& config, std::uint64_t seed);

}  // namespace nilio::tools::bench
