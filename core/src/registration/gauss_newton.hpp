#pragma once

#include "core/src/registration/registration.hpp"
#include "core/src/thread_sanitizer.hpp"

#include <cstddef>
#include <span>

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

namespace nilio::core {

/// Points of a voxel share the error of its plane, which averages out with no number of points: lower bound
/// of the error of a registered pose.
inline constexpr double kScanErrorMetres = 0.007;

/// Sums `accumulate(point, sums)` over all points in a fixed order.
template <class Sums, class Accumulate>
Sums sum_points(std::span<const Eigen::Vector3f> points, const Accumulate& accumulate) {
  // Points per leaf of the reduction. Fixed, so that the tree and every rounding depend on the number of
  // points only.
  constexpr std::size_t grain = 512;
  using Range = tbb::blocked_range<std::size_t>;
  char order = 0;
  sanitizer_release(&order);
  const Sums sum = tbb::parallel_deterministic_reduce(
      Range(0, points.size(), grain), Sums{},
      [&](const Range& range, Sums sums) {
        sanitizer_acquire(&order);
        for (std::size_t i = range.begin(); i < range.end(); ++i) accumulate(points[i], sums);
        sanitizer_release(&order);
        return sums;
      },
      [](Sums a, const Sums& b) { return a += b; });
  sanitizer_acquire(&order);
  return sum;
}

/// Sums `accumulate(point, equations)`, which fills the upper triangle of H.
template <class Accumulate>
NormalEquations reduce_points(std::span<const Eigen::Vector3f> points, const Accumulate& accumulate) {
  NormalEquations sum = sum_points<NormalEquations>(points, accumulate);
  sum.H.triangularView<Eigen::StrictlyLower>() = sum.H.transpose();
  return sum;
}

/// Gain of an update with this information: what it leaves of the prediction's error is (I - gain) times it.
Matrix6 gain_of(const Matrix6& predicted_covariance, const Matrix6& information);

/// Share of the scan that the map took last in the voxels that determine the pose, along each direction in
/// axes of the moving frame; none in directions that the scan does not show. Identity where it is not known.
Matrix6 share_of_newest_scan(const RegistrationResult& registration, const Matrix6& predicted_covariance);

enum class StepOutcome { kStepped, kConverged, kNonFinite };

/// Solves the equations and applies the step. Unobserved directions keep the initial guess or follow the
/// prior (solution remapping; Zhang, Kaess, Singh 2016).
StepOutcome apply_step(const NormalEquations& equations, const SolverOptions& options,
                       RegistrationResult& result);

/// Work of one iteration.
struct IterationWork {
  WorkKind kind;
  std::size_t points;
};

/// Gauss-Newton until convergence; `linearise(T)` gives the equations at T.
template <class Linearise>
void iterate(const Linearise& linearise, const IterationWork& work, const SolverOptions& options,
             RegistrationResult& result) {
  result.stop_reason = StopReason::kMaxIterations;
  for (int i = 0; i < options.max_iterations; ++i) {
    if (options.budget != nullptr && !options.budget->allows(work.kind, work.points)) {
      result.stop_reason = StopReason::kBudget;
      return;
    }
    result.equations = linearise(result.T_map_moving);
    ++result.iterations;
    if (options.budget != nullptr) options.budget->record(work.kind, work.points);
    if (result.equations.correspondences < options.min_correspondences) {
      result.stop_reason = StopReason::kTooFewPoints;
      return;
    }
    switch (apply_step(result.equations, options, result)) {
      case StepOutcome::kStepped:
        break;
      case StepOutcome::kConverged:
        result.stop_reason = StopReason::kConverged;
        return;
      case StepOutcome::kNonFinite:
        result.stop_reason = StopReason::kNonFinite;
        return;
    }
  }
}

}  // namespace nilio::core
