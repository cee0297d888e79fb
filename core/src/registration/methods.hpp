#pragma once

#include "nilio/core/odometry_config.hpp"

#include "core/src/map/gaussian_voxel_map.hpp"
#include "core/src/map/point_voxel_map.hpp"
#include "core/src/registration/registration.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

namespace nilio::core {

/// Kernel scales of NDT, wide then exact; its convergence basin is 3 m with voxels of 2 m.
inline constexpr std::array<double, 2> kNdtKernelSchedule = {5.0, 2.0};

/// Convergence thresholds of NDT at each scale, metres and radians.
struct CoarseEpsilon {
  double translation_m = 0.01;
  double rotation_rad = 1e-3;
};

/// Coarse stage: NDT through its kernel schedule, at most `max_iterations` at each scale. `budget` as in
/// SolverOptions.
RegistrationResult register_coarsely(const VoxelMap& gaussians, std::span<const Eigen::Vector3f> points,
                                     const SE3& T_map_guess, int max_iterations,
                                     ComputeBudget* budget = nullptr, const CoarseEpsilon& epsilon = {});

/// Maps to register against. `points` is required only by methods that need points.
struct RegistrationMaps {
  const VoxelMap* planes = nullptr;
  const VoxelMap* gaussians = nullptr;
  const PointMap* points = nullptr;
};

struct RegistrationMethodInfo {
  RegistrationMethod method;
  const char* name;  ///< in configuration and tables
  /// NDT runs before it as configured by odometry.coarse.
  bool coarse;
  bool needs_points;
  /// Registers from an initial guess. Inliers are comparable from scan to scan.
  RegistrationResult (*refine)(const RegistrationMaps& maps, std::span<const Eigen::Vector3f> points,
                               const SE3& T_map_guess, const PlaneMetric& metric,
                               const SolverOptions& options);
};

/// All methods, the default first.
std::span<const RegistrationMethodInfo> registration_methods();
const RegistrationMethodInfo& info_of(RegistrationMethod method);
/// Returns nullptr for an unknown name.
const RegistrationMethodInfo* find_registration_method(std::string_view name);

}  // namespace nilio::core
