#pragma once

#include "core/src/registration/registration.hpp"

#include <cstddef>

namespace nilio::core {

/// Points of a voxel share the error of its plane, which averages out with no number of points: lower bound
/// of the error of a registered pose.
inline constexpr double kScanErrorMetres = 0.007;

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
