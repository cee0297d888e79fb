#pragma once

#include "nilio/core/registration_method.hpp"

#include "core/src/map/gaussian_voxel_map.hpp"
#include "core/src/map/point_voxel_map.hpp"
#include "core/src/registration/registration.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

namespace nilio::core {

/// Kernel scales of NDT, wide first, then exact: with this schedule its basin reaches as far as its voxels
/// see (3 m at 2 m voxels).
inline constexpr std::array<double, 2> kNdtKernelSchedule = {5.0, 2.0};

/// A smaller step ends NDT at each of its scales, metres and radians.
struct CoarseEpsilon {
  double translation_m = 0.01;
  double rotation_rad = 1e-3;
};

/// The coarse stage: NDT through its kernel schedule, at most `max_iterations` at each scale, as far as ICP
/// needs. `budget` as in SolverOptions.
RegistrationResult register_coarsely(const VoxelMap& gaussians, std::span<const Eigen::Vector3f> points,
                                     const SE3& T_map_guess, int max_iterations,
                                     ComputeBudget* budget = nullptr, const CoarseEpsilon& epsilon = {});

/// What methods register against. `points` only has to be there for those that need it.
struct RegistrationMaps {
  const VoxelMap* planes = nullptr;
  const VoxelMap* gaussians = nullptr;
  const PointMap* points = nullptr;
};

struct RegistrationMethodInfo {
  RegistrationMethod method;
  const char* name;  ///< in configuration and tables
  /// NDT runs before it where odometry.coarse says so.
  bool coarse;
  bool needs_points;
  /// From a guess to the pose. The inliers of the result are comparable from scan to scan.
  RegistrationResult (*refine)(const RegistrationMaps& maps, std::span<const Eigen::Vector3f> points,
                               const SE3& T_map_guess, const PlaneMetric& metric,
                               const SolverOptions& options);
};

/// All methods, the default first.
std::span<const RegistrationMethodInfo> registration_methods();
const RegistrationMethodInfo& info_of(RegistrationMethod method);
/// Nullptr for a name that no method has.
const RegistrationMethodInfo* find_registration_method(std::string_view name);

}  // namespace nilio::core
