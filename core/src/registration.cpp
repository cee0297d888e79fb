#include "nilio/core/registration.hpp"

#include "registration_solver.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

namespace nilio::core {

namespace {

/// Unobserved directions of one 3x3 block of H, normalised so that a well observed direction is near 1/3.
struct BlockObservability {
  Matrix3 observed = Matrix3::Identity();  ///< projector onto the observed directions
  std::uint8_t weak_axes = 0;
};

BlockObservability observe(const Matrix3& block, double threshold) {
  BlockObservability result;
  const double trace = block.trace();
  if (!(trace > 0.0)) return {Matrix3::Zero(), 0b111};
  Eigen::SelfAdjointEigenSolver<Matrix3> solver;
  solver.computeDirect(block / trace);
  for (int i = 0; i < 3; ++i) {
    if (solver.eigenvalues()[i] >= threshold) continue;
    const Vector3 direction = solver.eigenvectors().col(i);
    result.observed -= direction * direction.transpose();
    Eigen::Index axis = 0;
    direction.cwiseAbs().maxCoeff(&axis);
    result.weak_axes = static_cast<std::uint8_t>(result.weak_axes | (1U << axis));
  }
  return result;
}

}  // namespace

StepOutcome apply_step(const NormalEquations& equations, const SolverOptions& options,
                       RegistrationResult& result) {
  const BlockObservability translation =
      observe(equations.H.topLeftCorner<3, 3>(), options.degeneracy_threshold);
  const BlockObservability rotation =
      observe(equations.H.bottomRightCorner<3, 3>(), options.degeneracy_threshold);
  result.degenerate_axes = static_cast<std::uint8_t>(translation.weak_axes | (rotation.weak_axes << 3U));
  Vector6 step = -equations.H.ldlt().solve(equations.b);
  step.head<3>() = translation.observed * step.head<3>();
  step.tail<3>() = rotation.observed * step.tail<3>();
  if (!step.allFinite()) return StepOutcome::kNonFinite;
  result.T_map_moving = result.T_map_moving * se3_exp(step);
  const bool small = step.head<3>().norm() < options.translation_epsilon_m &&
                     step.tail<3>().norm() < options.rotation_epsilon_rad;
  return small ? StepOutcome::kConverged : StepOutcome::kStepped;
}

NormalEquations& NormalEquations::operator+=(const NormalEquations& other) {
  H += other.H;
  b += other.b;
  weighted_square_error += other.weighted_square_error;
  weight_sum += other.weight_sum;
  correspondences += other.correspondences;
  inliers += other.inliers;
  return *this;
}

RegistrationResult register_planes(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                   const SE3& T_map_guess, const PlaneMetric& metric,
                                   const SolverOptions& options) {
  RegistrationResult result;
  result.T_map_moving = T_map_guess;
  iterate([&](const SE3& T_map_moving) { return plane_equations(map, points, T_map_moving, metric); },
          options, result);
  return result;
}

RegistrationResult register_ndt(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                const SE3& T_map_guess, std::span<const double> kernel_scales,
                                const SolverOptions& options) {
  RegistrationResult result;
  result.T_map_moving = T_map_guess;
  for (const double scale : kernel_scales) {
    iterate([&](const SE3& T_map_moving) { return ndt_equations(map, points, T_map_moving, {scale}); },
            options, result);
    if (result.stop_reason != StopReason::kConverged && result.stop_reason != StopReason::kMaxIterations)
      break;
  }
  return result;
}

}  // namespace nilio::core
