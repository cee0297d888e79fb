#include "core/src/registration/gauss_newton.hpp"

#include "core/src/linear_algebra.hpp"
#include "core/src/registration/registration.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

// Residuals of neighbouring points are correlated through their voxel: this many count as one. Calibrated on
// simulated drives, with the floors of the pose covariance.
constexpr double kCorrelatedResiduals = 2.0;
// Lower bound of the unit of time of a sweep, s: numerical.
constexpr double kMinSweepUnit = 1e-4;
// Keeps what a scan does not show out of an inverse, relative: numerical.
constexpr double kRidge = 1e-9;
constexpr double kMinResidualVariance = 0.01 * 0.01;
// A direction known worse than this from the scan alone is degenerate: 5 cm, the deviation of a point from a
// plane, or the same at the lever by rotation.
constexpr double kKnownMetres = 0.05;

/// Unobserved directions of one 3x3 block of H, normalised so that a well observed direction is near 1/3.
struct BlockObservability {
  Matrix3 observed = Matrix3::Identity();  ///< projector onto the observed directions
  std::uint8_t unobserved_axes = 0;
};

BlockObservability observe(const Matrix3& block, double threshold) {
  BlockObservability result;
  const double trace = block.trace();
  if (!(trace > 0.0)) return {Matrix3::Zero(), 0b111};
  const SymmetricEigen3 eigen = symmetric_eigen(Matrix3(block / trace));
  for (int i = 0; i < 3; ++i) {
    if (eigen.values[i] >= threshold) continue;
    const Vector3 direction = eigen.vectors.col(i);
    result.observed -= direction * direction.transpose();
    Eigen::Index axis = 0;
    direction.cwiseAbs().maxCoeff(&axis);
    result.unobserved_axes = static_cast<std::uint8_t>(result.unobserved_axes | (1U << axis));
  }
  return result;
}

bool is_small(const Vector6& step, const SolverOptions& options) {
  return step.head<3>().norm() < options.translation_epsilon_m &&
         step.tail<3>().norm() < options.rotation_epsilon_rad;
}

StepOutcome take_step(const Vector6& step, const SolverOptions& options, RegistrationResult& result) {
  if (!step.allFinite()) return StepOutcome::kNonFinite;
  result.T_map_moving = result.T_map_moving * se3_exp(step);
  return is_small(step, options) ? StepOutcome::kConverged : StepOutcome::kStepped;
}

/// An error in metres on every axis, of rotation that which moves a point at the lever as far.
Vector6 pose_error(double metres) {
  Vector6 error;
  error << Vector3::Constant(metres), Vector3::Constant(metres / kErrorLeverMetres);
  return error;
}

/// Axes closest to the directions that the scan alone shows worse than required.
std::uint8_t find_weak_axes(const Matrix6& information) {
  const Vector6 known = pose_error(kKnownMetres);
  const Matrix6 scaled = known.asDiagonal() * information * known.asDiagonal();
  const SymmetricEigen6 eigen = symmetric_eigen(scaled);
  std::uint8_t axes = 0;
  for (int i = 0; i < 6 && eigen.values[i] < 1.0; ++i) {
    Eigen::Index axis = 0;
    eigen.vectors.col(i).cwiseAbs().maxCoeff(&axis);
    axes = static_cast<std::uint8_t>(axes | (1U << axis));
  }
  return axes;
}

/// Variance of a residual, m^2, less the `spread` of non-planar voxels in the weighted squares.
double residual_variance(const NormalEquations& equations, double spread) {
  const double square =
      equations.weight_sum > 0.0 ? (equations.weighted_square_error - spread) / equations.weight_sum : 0.0;
  return kCorrelatedResiduals * std::max(kMinResidualVariance, square);
}

/// Variance of the error that all points share.
Vector6 shared_error() { return pose_error(kScanErrorMetres).cwiseAbs2(); }

/// Adds the error that all points share to the covariance; returns its inverse.
Matrix6 with_error(const Matrix6& information) {
  const Matrix6 result = information_with(Matrix6(shared_error().asDiagonal()), information);
  return 0.5 * (result + result.transpose());
}

/// Information of a scan beside a prediction that an IMU measured. A direction that the scan shows worse than
/// required rests on few voxels, whose errors last from scan to scan, as those of the IMU do, and would
/// become a velocity: its variance v, in units of the required one, counts as v + v^2.
Matrix6 without_lasting_errors(const Matrix6& information) {
  const Matrix6 known = pose_error(kKnownMetres).cwiseAbs2().asDiagonal();
  return information * known * information_with(known, information);
}

/// S with which S^T H S is H without the spurious information of noisy normals, as along the axis of a tube,
/// or about the yaw on bare ground: what they add along each principal direction of H, where rotations move a
/// point at the lever, is taken from it, or all that there is.
Matrix6 shrink_of_normals(const NormalEquations& equations) {
  const Vector6 metre = pose_error(1.0);
  const Matrix6 H = metre.asDiagonal() * equations.H * metre.asDiagonal();
  const Matrix6 spurious = metre.asDiagonal() * equations.H_normals * metre.asDiagonal();
  const SymmetricEigen6 eigen = symmetric_eigen(H);
  const Vector6 added = (eigen.vectors.transpose() * spurious * eigen.vectors).diagonal();
  Vector6 left = Vector6::Zero();
  for (int i = 0; i < 6; ++i)
    if (eigen.values[i] > 0.0) left[i] = std::sqrt(std::max(0.0, 1.0 - added[i] / eigen.values[i]));
  const Matrix6 shrink = eigen.vectors * left.asDiagonal() * eigen.vectors.transpose();
  return metre.asDiagonal() * shrink * metre.cwiseInverse().asDiagonal();
}

/// Information of the scan alone.
Matrix6 scan_information(const NormalEquations& equations, const Matrix6& shrink) {
  return shrink.transpose() * equations.H * shrink / measurement_variance(equations);
}

/// Information of the scan about the pose, and the axes that it does not observe.
void set_information(const NormalEquations& equations, const Matrix6& shrink, bool is_measured,
                     RegistrationResult& result) {
  const Matrix6 information = scan_information(equations, shrink);
  // The spread of non-planar voxels does not tell how well a direction is shown.
  const double spread =
      measurement_variance(equations) / residual_variance(equations, equations.gaussian_square_excess);
  const Matrix6 shown = spread * information;
  result.degenerate_axes = find_weak_axes(shown);
  result.information =
      with_error(is_measured ? Matrix6(without_lasting_errors(shown) / spread) : information);
}

/// Share of the covariance of each axis that a step removes.
Vector6 observability_of(const Matrix6& before, const Matrix6& after) {
  return (1.0 - after.diagonal().array() / before.diagonal().array()).cwiseMax(0.0).cwiseMin(1.0).matrix();
}

/// Gauss-Newton step of scan and prior.
StepOutcome step_with_prior(const NormalEquations& equations, const SolverOptions& options,
                            RegistrationResult& result) {
  const PosePrior& prior = *options.prior;
  const Vector6 offset = se3_log(prior.T_map_moving.inverse() * result.T_map_moving);
  const Matrix6 held = inverse_ldlt(prior.covariance);
  set_information(equations, shrink_of_normals(equations), prior.is_measured, result);
  const Matrix6 combined = result.information + held;
  const Vector6 wanted = -solve_ldlt(equations.H, equations.b);
  const Vector6 step = solve_ldlt(combined, result.information * wanted - held * offset);
  result.observability = observability_of(prior.covariance, inverse_ldlt(combined));
  return take_step(step, options, result);
}

/// Information about pose and twist in the units of H, with the errors that points share.
Matrix12 sweep_information(const NormalEquations& equations, const Matrix12& H, const Matrix6& shrink) {
  Matrix12 both = Matrix12::Zero();
  both.topLeftCorner<6, 6>() = both.bottomRightCorner<6, 6>() = shrink;
  const Matrix12 sharp = both.transpose() * H * both / measurement_variance(equations);
  Vector12 shared;
  shared << shared_error(), shared_error();
  const Matrix12 result = solve_lu(Matrix12(Matrix12::Identity() + sharp * shared.asDiagonal()), sharp);
  return 0.5 * (result + result.transpose());
}

/// Gauss-Newton step of pose and twist. The twist is taken in units of the points' root mean square time, in
/// which its errors are those of the pose.
StepOutcome step_of_sweep(const NormalEquations& equations, const SolverOptions& options,
                          RegistrationResult& result) {
  const SweepPrior& prior = options.sweep->prior;
  double square = 0.0;
  for (const float t : options.sweep->times_s) square += static_cast<double>(t) * static_cast<double>(t);
  const double count = static_cast<double>(options.sweep->times_s.size());
  const double unit_s = std::max(std::sqrt(square / count), kMinSweepUnit);
  Vector12 units;
  units << Vector6::Ones(), Vector6::Constant(unit_s);
  const Vector12 per_unit = units.cwiseInverse();
  Matrix12 H;
  H << equations.H, equations.H_cross, equations.H_cross, equations.H_twist;
  H = (per_unit.asDiagonal() * H * per_unit.asDiagonal()).eval();
  Vector12 b;
  b << equations.b, equations.b_twist / unit_s;
  Vector12 offset;
  offset << se3_log(prior.T_map_middle.inverse() * result.T_map_moving),
      unit_s * (result.twist - prior.twist);
  const Matrix12 held = inverse_ldlt(Matrix12(units.asDiagonal() * prior.covariance * units.asDiagonal()));
  const Matrix6 shrink = shrink_of_normals(equations);
  const Matrix12 information = sweep_information(equations, H, shrink);
  const Matrix12 combined = information + held;
  const Vector12 wanted = -solve_ldlt(H, b);
  const Vector12 step = solve_ldlt(combined, Vector12(information * wanted - held * offset));
  set_information(equations, shrink, false, result);
  result.observability =
      observability_of(prior.covariance.topLeftCorner<6, 6>(), inverse_ldlt(combined).topLeftCorner<6, 6>());
  result.sweep_information = units.asDiagonal() * information * units.asDiagonal();
  result.twist += step.tail<6>() / unit_s;
  const StepOutcome outcome = take_step(step.head<6>(), options, result);
  return outcome == StepOutcome::kConverged && !is_small(step.tail<6>(), options) ? StepOutcome::kStepped
                                                                                  : outcome;
}

}  // namespace

double measurement_variance(const NormalEquations& equations) { return residual_variance(equations, 0.0); }

Matrix6 gain_of(const Matrix6& predicted_covariance, const Matrix6& information) {
  return predicted_covariance * information_with(predicted_covariance, information);
}

Matrix6 share_of_newest_scan(const RegistrationResult& registration, const Matrix6& predicted_covariance) {
  const NormalEquations& equations = registration.equations;
  if (!(equations.H_newest.trace() > 0.0)) return Matrix6::Identity();
  const Matrix6 ridge = kRidge * equations.H.trace() * Matrix6::Identity();
  // A good prediction does not hide what a scan shows.
  const Matrix6 known = pose_error(kKnownMetres).cwiseAbs2().asDiagonal();
  return gain_of(predicted_covariance + known, registration.information) *
         solve_lu(Matrix6(equations.H + ridge), equations.H_newest);
}

StepOutcome apply_step(const NormalEquations& equations, const SolverOptions& options,
                       RegistrationResult& result) {
  if (options.sweep != nullptr) return step_of_sweep(equations, options, result);
  if (options.prior) return step_with_prior(equations, options, result);
  const BlockObservability translation =
      observe(equations.H.topLeftCorner<3, 3>(), options.degeneracy_threshold);
  const BlockObservability rotation =
      observe(equations.H.bottomRightCorner<3, 3>(), options.degeneracy_threshold);
  result.degenerate_axes =
      static_cast<std::uint8_t>(translation.unobserved_axes | (rotation.unobserved_axes << 3U));
  result.information = with_error(scan_information(equations, shrink_of_normals(equations)));
  Vector6 step = -solve_ldlt(equations.H, equations.b);
  step.head<3>() = translation.observed * step.head<3>();
  step.tail<3>() = rotation.observed * step.tail<3>();
  return take_step(step, options, result);
}

}  // namespace nilio::core
