#include "core/src/registration/registration.hpp"

#include "core/src/registration/gauss_newton.hpp"

namespace nilio::core {

RegistrationResult register_planes(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                   const SE3& T_map_guess, const PlaneMetric& metric,
                                   const SolverOptions& options) {
  RegistrationResult result;
  result.T_map_moving = T_map_guess;
  SweepChange change{options.sweep};
  if (options.sweep != nullptr) result.twist = options.sweep->deskew_twist;
  const auto linearise = [&](const SE3& T_map_moving) {
    if (options.sweep != nullptr) change.twist = result.twist - options.sweep->deskew_twist;
    return plane_equations(map, points, T_map_moving, metric, change);
  };
  iterate(linearise, {WorkKind::kIcp, points.size()}, options, result);
  return result;
}

RegistrationResult register_ndt(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                const SE3& T_map_guess, std::span<const double> kernel_scales,
                                const SolverOptions& options) {
  RegistrationResult result;
  result.T_map_moving = T_map_guess;
  for (const double scale : kernel_scales) {
    iterate([&](const SE3& T_map_moving) { return ndt_equations(map, points, T_map_moving, {scale}); },
            {WorkKind::kNdt, points.size()}, options, result);
    if (result.stop_reason != StopReason::kConverged && result.stop_reason != StopReason::kMaxIterations)
      break;
  }
  return result;
}

}  // namespace nilio::core
