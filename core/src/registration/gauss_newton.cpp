#include "core/src/registration/gauss_newton.hpp"

#include "core/src/registration/registration.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace nilio::core {

namespace {

// Neighbouring points meet the same voxels, so their residuals are not independent: this many say one thing.
// Measured on simulated drives with the floors of the pose's covariance, where the true error is 0.5 to 0.7
// of what is said.
constexpr double kCorrelatedResiduals = 2.0;
// What turns a point 30 m away by as much as no scan's place is known better than.
constexpr double kMinRadians = kScanErrorMetres / 30.0;
constexpr double kMinResidualVariance = 0.01 * 0.01;
// A direction that the scan shows worse than this is weak: 5 cm, which is how well a point lies on a plane,
// and what turns a point 30 m away by as much.
constexpr double kKnownMetres = 0.05;
constexpr double kKnownRadians = kKnownMetres / 30.0;

// Twice what normals are off by: in a bare tube the squares that they show along it are one to two times what
// follows from thickness, spread and number of the planes' points; where there is something to see, ten
// times.
constexpr double kNormalMargin = 2.0 * 2.0;

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

/// What normals that are not exact make of one 3x3 block of H: in a bare tube they all lean a little along
/// it, and each lean counts as a sight of the motion there. Normals that err by the square root of `share`
/// add that share of the other directions' weight to each. The matrix shrinks a step's equations to what is
/// left.
Matrix3 shrink_of(const Matrix3& block, double share) {
  const double trace = block.trace();
  if (!(trace > 0.0)) return Matrix3::Zero();
  Eigen::SelfAdjointEigenSolver<Matrix3> solver;
  solver.computeDirect(block / trace);
  Matrix3 shrink = Matrix3::Zero();
  for (int i = 0; i < 3; ++i) {
    const double seen = solver.eigenvalues()[i];
    const double left = seen - share * (1.0 - seen);
    if (left <= 0.0) continue;
    const Vector3 direction = solver.eigenvectors().col(i);
    shrink += std::sqrt(left / seen) * direction * direction.transpose();
  }
  return shrink;
}

StepOutcome take_step(const Vector6& step, const SolverOptions& options, RegistrationResult& result) {
  if (!step.allFinite()) return StepOutcome::kNonFinite;
  result.T_map_moving = result.T_map_moving * se3_exp(step);
  const bool small = step.head<3>().norm() < options.translation_epsilon_m &&
                     step.tail<3>().norm() < options.rotation_epsilon_rad;
  return small ? StepOutcome::kConverged : StepOutcome::kStepped;
}

/// Axes that the directions lie along which the scan alone would not show as well as it should.
std::uint8_t find_weak_axes(const Matrix6& information) {
  Vector6 known;
  known << Vector3::Constant(kKnownMetres), Vector3::Constant(kKnownRadians);
  const Matrix6 scaled = known.asDiagonal() * information * known.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix6> solver(scaled);
  std::uint8_t axes = 0;
  for (int i = 0; i < 6 && solver.eigenvalues()[i] < 1.0; ++i) {
    Eigen::Index axis = 0;
    solver.eigenvectors().col(i).cwiseAbs().maxCoeff(&axis);
    axes = static_cast<std::uint8_t>(axes | (1U << axis));
  }
  return axes;
}

/// Information of what is uncertain by kScanErrorMetres, or what turns a point 30 m away by as much, beside.
Matrix6 with_error(const Matrix6& information) {
  Vector6 variance;
  variance << Vector3::Constant(kScanErrorMetres * kScanErrorMetres),
      Vector3::Constant(kMinRadians * kMinRadians);
  const Matrix6 spread = Matrix6::Identity() + information * variance.asDiagonal();
  const Matrix6 result = spread.partialPivLu().solve(information);
  return 0.5 * (result + result.transpose());
}

/// Gauss-Newton step of scan and prior together. Vehicles mostly do as predicted and seldom something else,
/// so an axis that the scan has moved away from the prediction is held less (Cauchy's weight), unless what
/// they do is felt.
StepOutcome step_with_prior(const NormalEquations& equations, const SolverOptions& options,
                            RegistrationResult& result) {
  const PosePrior& prior = *options.prior;
  const SE3 moved = prior.T_map_moving.inverse() * result.T_map_moving;
  Vector6 offset;
  offset << moved.rotation.conjugate() * moved.translation, so3_log(moved.rotation);
  Vector6 held = (prior.variance.array() + offset.array().square()).inverse().matrix();
  if (prior.translation_is_gaussian) held.head<3>() = prior.variance.head<3>().cwiseInverse();
  // Turning is seen by levers of many lengths, for which the other directions' weight is no measure.
  Matrix6 shrink = Matrix6::Identity();
  const double normal_variance = equations.normal_square / std::max(equations.weight_sum, 1e-12);
  shrink.topLeftCorner<3, 3>() =
      shrink_of(equations.H.topLeftCorner<3, 3>(), kNormalMargin * normal_variance);
  const Matrix6 information = shrink * equations.H * shrink / measurement_variance(equations);
  const Matrix6 weighed = with_error(information);
  const Eigen::LDLT<Matrix6> factor(weighed + Matrix6(held.asDiagonal()));
  const Vector6 wanted = -equations.H.ldlt().solve(equations.b);
  const Vector6 step = factor.solve(weighed * wanted - held.cwiseProduct(offset));
  result.degenerate_axes = find_weak_axes(information);
  const Matrix6 covariance = factor.solve(Matrix6::Identity());
  result.observability =
      (1.0 - covariance.diagonal().array() * held.array()).cwiseMax(0.0).cwiseMin(1.0).matrix();
  return take_step(step, options, result);
}

}  // namespace

double measurement_variance(const NormalEquations& equations) {
  const double square =
      equations.weight_sum > 0.0 ? equations.weighted_square_error / equations.weight_sum : 0.0;
  return kCorrelatedResiduals * std::max(kMinResidualVariance, square);
}

StepOutcome apply_step(const NormalEquations& equations, const SolverOptions& options,
                       RegistrationResult& result) {
  if (options.prior) return step_with_prior(equations, options, result);
  const BlockObservability translation =
      observe(equations.H.topLeftCorner<3, 3>(), options.degeneracy_threshold);
  const BlockObservability rotation =
      observe(equations.H.bottomRightCorner<3, 3>(), options.degeneracy_threshold);
  result.degenerate_axes = static_cast<std::uint8_t>(translation.weak_axes | (rotation.weak_axes << 3U));
  Vector6 step = -equations.H.ldlt().solve(equations.b);
  step.head<3>() = translation.observed * step.head<3>();
  step.tail<3>() = rotation.observed * step.tail<3>();
  return take_step(step, options, result);
}

}  // namespace nilio::core
