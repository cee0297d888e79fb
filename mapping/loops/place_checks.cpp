#include "mapping/loops/place_checks.hpp"

#include "core/src/linear_algebra.hpp"

#include <algorithm>
#include <array>

namespace nilio::mapping {

namespace {

using core::Matrix6;
using core::SE3;
using core::Vector3;
using core::Vector6;

constexpr double kMaxPathsMetres = 12.0;
constexpr std::uint32_t kMinCompared = 300;
constexpr double kMinOverlap = 0.4;
// A direction with a larger deviation is not observed.
constexpr double kObservedMetres = 0.3;
constexpr double kObservedRadians = 0.02;
// Surfaces of a place share errors: drift inside of it, voxels that lie differently. Calibrated on simulated
// drives, see docs/map.md.
constexpr double kLoopMetres = 0.08;
constexpr double kLoopRadians = 0.001;

}  // namespace

const char* verdict_name(LoopVerdict verdict) {
  constexpr std::array<const char*, kLoopVerdicts> names{
      "accepted",  "far",        "drift", "overlap", "support",     "free space",
      "ambiguous", "unobserved", "tilt",  "alone",   "inconsistent"};
  return names.at(static_cast<std::size_t>(verdict));
}

Matrix6 with_common_errors(const Matrix6& information) {
  Vector6 variance;
  variance << Vector3::Constant(kLoopMetres * kLoopMetres), Vector3::Constant(kLoopRadians * kLoopRadians);
  const Matrix6 spread = Matrix6::Identity() + information * variance.asDiagonal();
  const Matrix6 result = core::solve_lu(spread, information);
  // A direction that is not observed at all still needs an invertible matrix.
  return 0.5 * (result + result.transpose()) + 1e-6 * Matrix6::Identity();
}

std::size_t unobserved_directions(const Matrix6& information) {
  Vector6 scale;
  scale << Vector3::Constant(kObservedMetres), Vector3::Constant(kObservedRadians);
  const Vector6 values =
      core::symmetric_eigen(Matrix6(scale.asDiagonal() * information * scale.asDiagonal())).values;
  return static_cast<std::size_t>((values.array() < 1.0).count());
}

std::optional<SE3> with_height(SE3 guess, const Place& reference, const Place& moving) {
  double nearest = kMaxPathsMetres * kMaxPathsMetres;
  double height = 0.0;
  bool found = false;
  for (const SE3& pose : moving.path) {
    const Vector3 p = guess * pose.translation;
    for (const SE3& other : reference.path) {
      const double square = (p - other.translation).head<2>().squaredNorm();
      if (square >= nearest) continue;
      nearest = square;
      height = other.translation.z() - p.z();
      found = true;
    }
  }
  guess.translation.z() += height;
  return found ? std::optional(guess) : std::nullopt;
}

CheckedAlignment check_alignment(const ComparablePlace& reference, const ComparablePlace& moving,
                                 const SE3& guess, const CheckLimits& limits) {
  CheckedAlignment result;
  result.alignment = align_places(reference, moving, guess, limits.registered_surfaces);
  result.alignment.information = with_common_errors(result.alignment.information);
  const PlaceAlignment& alignment = result.alignment;
  const SE3& T = alignment.T_reference_moving;
  const auto refuse = [&](LoopVerdict verdict) {
    result.verdict = verdict;
    return result;
  };
  if (T.translation.head<2>().norm() > limits.max_centre_m) return refuse(LoopVerdict::kFar);
  const double self = std::max({reference.self_support(), moving.self_support(), 1e-3});
  result.support_share = alignment.support / self;
  result.larger_support_share = alignment.larger_support / self;
  if (alignment.overlap < kMinOverlap || alignment.compared < kMinCompared)
    return refuse(LoopVerdict::kOverlap);
  if (result.support_share < limits.min_support_share) return refuse(LoopVerdict::kSupport);
  if (alignment.contradiction > limits.max_contradiction) return refuse(LoopVerdict::kFreeSpace);
  if (limits.max_ambiguity < 1.0) result.ambiguity = ambiguity(reference.place(), moving.place(), T);
  if (result.ambiguity > limits.max_ambiguity) return refuse(LoopVerdict::kAmbiguous);
  if (unobserved_directions(alignment.information) > 1) return refuse(LoopVerdict::kUnobserved);
  return result;
}

}  // namespace nilio::mapping
