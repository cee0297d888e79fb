#include "tools/inspect/imu_calibration/force_alignment.hpp"

#include "nilio/core/units.hpp"

#include "core/src/estimation/stationary_detector.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>

namespace nilio::tools::inspect {

namespace {

// Scans per velocity: the noise of a position has to be small against 1 m/s^2.
constexpr std::size_t kSpan = 5;
constexpr double kUnevenness = 0.1;
constexpr double kSteadyAcceleration = 1.0;
constexpr std::size_t kMinimumSteady = 30;
constexpr std::size_t kMinimumCompared = 50;
// Neighbouring results share all but one scan and are correlated.
constexpr double kOverlap = 10.0;
// base_link is upright on average, but single roads are not level.
constexpr double kGravitySigma = 2.0 * kRadiansPerDegree;
// Suspension and a wrong lever arm are correlated with the forces.
constexpr double kMinimumHorizontalSigma = 1.0 * kRadiansPerDegree;
constexpr double kMaximumHorizontalSigma = 10.0 * kRadiansPerDegree;

/// Specific force of the IMU and of the registered motion, both in base_link, and the acceleration.
struct ForcePair {
  core::Vector3 measured = core::Vector3::Zero();
  core::Vector3 actual = core::Vector3::Zero();
  double acceleration = 0.0;
};

bool is_one_piece(std::span<const core::RegisteredMotion> window) {
  const double mean = (window.back().to - window.front().from).seconds() / static_cast<double>(window.size());
  for (std::size_t i = 0; i < window.size(); ++i) {
    if (i > 0 && window[i].from != window[i - 1].to) return false;
    if (std::abs(window[i].seconds() - mean) > kUnevenness * mean) return false;
  }
  return true;
}

core::Vector3 up_in_odom(std::span<const core::RegisteredMotion> motions) {
  core::Vector3 sum = core::Vector3::Zero();
  for (const core::RegisteredMotion& motion : motions)
    sum += motion.T_odom_to.rotation * core::Vector3::UnitZ();
  return sum.norm() > 0.0 ? sum.normalized().eval() : core::Vector3::UnitZ().eval();
}

ForcePair compare(std::span<const core::RegisteredMotion> window, const core::ImuBuffer& imu,
                  const core::Vector3& imu_position, const core::Vector3& up) {
  const double half = 0.5 * (window.back().to - window.front().from).seconds();
  const core::RegisteredMotion& middle = window[kSpan];
  const core::Vector3 acceleration =
      (window.back().T_odom_to * imu_position - 2.0 * (middle.T_odom_from * imu_position) +
       window.front().T_odom_from * imu_position) /
      (half * half);
  ForcePair pair;
  pair.acceleration = acceleration.norm();
  pair.actual = middle.T_odom_from.rotation.conjugate() * (acceleration + core::kGravity * up);
  // A second difference of positions weights acceleration by a triangle; the specific force needs the same
  // weights.
  for (std::size_t i = 0; i < window.size(); ++i) {
    const double distance = static_cast<double>(std::min(i + 1, window.size() - i)) - 0.5;
    pair.measured += distance / static_cast<double>(kSpan * kSpan) *
                     core::mean_specific_force(imu, window[i].from, window[i].to);
  }
  return pair;
}

std::vector<ForcePair> compare_all(std::span<const core::RegisteredMotion> motions,
                                   const core::ImuBuffer& imu, const core::Vector3& imu_position,
                                   core::Duration max_gap) {
  std::vector<ForcePair> pairs;
  const core::Vector3 up = up_in_odom(motions);
  for (std::size_t i = 0; i + 2 * kSpan <= motions.size(); ++i) {
    const auto window = motions.subspan(i, 2 * kSpan);
    if (is_one_piece(window) && imu.covers(window.front().from, window.back().to, max_gap))
      pairs.push_back(compare(window, imu, imu_position, up));
  }
  return pairs;
}

/// Adds the pair of gravity; false with too little steady motion.
bool add_gravity(const std::vector<ForcePair>& forces, ForceComparison& result) {
  core::Vector3 measured = core::Vector3::Zero();
  core::Vector3 actual = core::Vector3::Zero();
  std::size_t steady = 0;
  for (const ForcePair& force : forces) {
    if (force.acceleration > kSteadyAcceleration) continue;
    measured += force.measured;
    actual += force.actual;
    ++steady;
  }
  if (steady < kMinimumSteady || measured.norm() == 0.0) return false;
  result.gravity_ratio = measured.norm() / actual.norm();
  result.pairs.push_back({measured.normalized(), actual.normalized(), kGravitySigma});
  return true;
}

struct Covariances {
  core::Matrix3 mm = core::Matrix3::Zero();
  core::Matrix3 am = core::Matrix3::Zero();
  double aa = 0.0;
};

/// Covariances of the horizontal components; the vertical ones are dominated by road bumps.
Covariances horizontal_covariances(const std::vector<ForcePair>& forces, const DirectionPair& gravity) {
  const core::Matrix3 across_measured =
      core::Matrix3::Identity() - gravity.measured * gravity.measured.transpose();
  const core::Matrix3 across_actual = core::Matrix3::Identity() - gravity.actual * gravity.actual.transpose();
  core::Vector3 mean_measured = core::Vector3::Zero();
  core::Vector3 mean_actual = core::Vector3::Zero();
  const double share = 1.0 / static_cast<double>(forces.size());
  for (const ForcePair& force : forces) {
    mean_measured += share * force.measured;
    mean_actual += share * force.actual;
  }
  Covariances c;
  for (const ForcePair& force : forces) {
    const core::Vector3 m = across_measured * (force.measured - mean_measured);
    const core::Vector3 a = across_actual * (force.actual - mean_actual);
    c.mm += share * m * m.transpose();
    c.am += share * a * m.transpose();
    c.aa += share * a.squaredNorm();
  }
  return c;
}

void add_horizontal(const std::vector<ForcePair>& forces, ForceComparison& result) {
  const Covariances c = horizontal_covariances(forces, result.pairs.front());
  const Eigen::SelfAdjointEigenSolver<core::Matrix3> solver(c.mm);
  const double floor = 1e-9 * result.gravity_ratio * result.gravity_ratio;
  double residual = c.aa;
  for (Eigen::Index k = 2; k >= 1; --k) {
    const double variance = solver.eigenvalues()[k];
    if (variance > floor) residual -= (c.am * solver.eigenvectors().col(k)).squaredNorm() / variance;
  }
  for (Eigen::Index k = 2; k >= 1; --k) {
    const double variance = solver.eigenvalues()[k];
    if (variance <= floor) return;
    const core::Vector3 direction = solver.eigenvectors().col(k);
    const core::Vector3 actual = c.am * direction / variance;
    const double independent = 2.0 * static_cast<double>(forces.size()) / kOverlap;
    const double sigma = std::sqrt(std::max(0.0, residual) / (independent * variance)) / actual.norm();
    if (!(sigma < kMaximumHorizontalSigma)) return;
    result.pairs.push_back({direction, actual.normalized(), std::max(sigma, kMinimumHorizontalSigma)});
  }
  result.spans_space = true;
}

}  // namespace

ForceComparison compare_forces(std::span<const core::RegisteredMotion> motions, const core::ImuBuffer& imu,
                               const core::Vector3& imu_position, core::Duration max_gap) {
  ForceComparison result;
  const std::vector<ForcePair> forces = compare_all(motions, imu, imu_position, max_gap);
  if (!add_gravity(forces, result)) return result;
  if (forces.size() >= kMinimumCompared) add_horizontal(forces, result);
  return result;
}

}  // namespace nilio::tools::inspect
