#include "nilio/core/registration.hpp"

#include "registration_solver.hpp"

namespace nilio::core {

NormalEquations& NormalEquations::operator+=(const NormalEquations& other) {
  H += other.H;
  b += other.b;
  weighted_square_error += other.weighted_square_error;
  weight_sum += other.weight_sum;
  normal_square += other.normal_square;
  correspondences += other.correspondences;
  inliers += other.inliers;
  agreement += other.agreement;
  return *this;
}

RegistrationResult register_planes(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                   const SE3& T_map_guess, const PlaneMetric& metric,
                                   const SolverOptions& options) {
  RegistrationResult result;
  result.T_map_moving = T_map_guess;
  iterate([&](const SE3& T_map_moving) { return plane_equations(map, points, T_map_moving, metric); },
          {Work::kIcp, points.size()}, options, result);
  return result;
}

RegistrationResult register_ndt(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                const SE3& T_map_guess, std::span<const double> kernel_scales,
                                const SolverOptions& options) {
  RegistrationResult result;
  result.T_map_moving = T_map_guess;
  for (const double scale : kernel_scales) {
    iterate([&](const SE3& T_map_moving) { return ndt_equations(map, points, T_map_moving, {scale}); },
            {Work::kNdt, points.size()}, options, result);
    if (result.stop_reason != StopReason::kConverged && result.stop_reason != StopReason::kMaxIterations)
      break;
  }
  return result;
}

}  // namespace nilio::core
