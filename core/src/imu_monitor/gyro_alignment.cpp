#include "core/src/imu_monitor/gyro_alignment.hpp"

#include "nilio/core/units.hpp"

#include "core/src/linear_algebra.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

namespace nilio::core {

namespace {

// Below this rate a scan's rotation is registration noise.
constexpr double kTurningRate = 1.0 * kRadiansPerDegree;
// One minute of turning at 10 Hz.
constexpr double kGyroMemory = 1.0 - 1.0 / 600.0;
constexpr double kMinGyroWeight = 20.0;
// The onset of a turn alone fits many shifts.
constexpr double kMinWeightForOffset = 60.0;
constexpr double kMinWeightAtEdge = 100.0;
// Variance that keeps directions without motion out of the fit, (0.06 deg/s)^2.
constexpr double kRidge = 1e-6;
constexpr double kLargestAngleSigma = 1.5 * kRadiansPerDegree;
// Small deskewing errors leak the strongest direction into weaker ones.
constexpr double kStrongShare = 0.1;
constexpr double kLargestOffsetSigma = 3e-3;
// Share of the registered rotation that the gyro must explain before its time offset is used.
constexpr double kMinExplained = 0.8;

}  // namespace

void GyroAlignment::add(const Vector3& registered, const std::array<Vector3, kTimeShifts>& gyro) {
  double fastest = registered.norm();
  for (const Vector3& rate : gyro) fastest = std::max(fastest, rate.norm());
  if (fastest < kTurningRate) return;
  weight_ = kGyroMemory * weight_ + 1.0;
  r_ = kGyroMemory * r_ + registered;
  rr_ = kGyroMemory * rr_ + registered.squaredNorm();
  for (std::size_t i = 0; i < kTimeShifts; ++i) {
    Sums& s = sums_[i];
    s.g = kGyroMemory * s.g + gyro[i];
    s.gg = kGyroMemory * s.gg + gyro[i] * gyro[i].transpose();
    s.rg = kGyroMemory * s.rg + registered * gyro[i].transpose();
  }
}

GyroAlignment::Covariances GyroAlignment::covariances(std::size_t shift) const {
  const Sums& s = sums_[shift];
  const double inverse = 1.0 / weight_;
  const Vector3 g = s.g * inverse;
  return {s.gg * inverse - g * g.transpose(), s.rg * inverse - r_ * inverse * g.transpose()};
}

double GyroAlignment::registered_variance() const { return rr_ / weight_ - (r_ / weight_).squaredNorm(); }

double GyroAlignment::residual(std::size_t shift) const {
  const Covariances c = covariances(shift);
  const Matrix3 inverse = (c.gg + kRidge * Matrix3::Identity()).inverse();
  return registered_variance() - (c.rg * inverse * c.rg.transpose()).trace();
}

void GyroAlignment::estimate_offset(std::size_t best, double least, GyroAlignmentEstimate& result) const {
  const bool explains = least < (1.0 - kMinExplained) * registered_variance();
  result.time_offset_s = shift_at(best).seconds();
  if (best == 0 || best + 1 == kTimeShifts) {
    result.time_offset_sigma_s = kShiftStep.seconds();
    result.time_offset_known = explains && weight_ > kMinWeightAtEdge;
    result.time_offset_found = result.time_offset_known;
    return;
  }
  const double before = residual(best - 1);
  const double after = residual(best + 1);
  const double bend = before - 2.0 * least + after;
  if (bend <= 0.0) return;
  const double step = kShiftStep.seconds();
  result.time_offset_s += 0.5 * step * (before - after) / bend;
  result.time_offset_sigma_s = step * std::sqrt(2.0 * least / (3.0 * weight_ * bend));
  result.time_offset_found = explains && result.time_offset_sigma_s < 2.0 * kLargestOffsetSigma;
  result.time_offset_known =
      explains && weight_ > kMinWeightForOffset && result.time_offset_sigma_s < kLargestOffsetSigma;
}

void GyroAlignment::find_directions(std::size_t best, double least, GyroAlignmentEstimate& result) const {
  const Covariances c = covariances(best);
  const SymmetricEigen3 gyro = symmetric_eigen(c.gg);
  for (Eigen::Index k = 2; k >= 0; --k) {
    const double variance = gyro.values[k];
    if (variance < kRidge) break;
    const Vector3 direction = gyro.vectors.col(k);
    const Vector3 registered = c.rg * direction / variance;
    const double sigma = std::sqrt(std::max(0.0, least) / (3.0 * weight_ * variance));
    if (sigma > kLargestAngleSigma * registered.norm()) break;
    const bool strong = variance > kStrongShare * gyro.values[2];
    result.directions[result.observed++] = {direction, registered, sigma / registered.norm(), strong};
  }
}

GyroAlignmentEstimate GyroAlignment::estimate() const {
  GyroAlignmentEstimate result;
  if (weight_ < kMinGyroWeight) return result;
  std::size_t best = 0;
  double least = residual(0);
  for (std::size_t i = 1; i < kTimeShifts; ++i) {
    const double candidate = residual(i);
    if (candidate >= least) continue;
    least = candidate;
    best = i;
  }
  estimate_offset(best, least, result);
  find_directions(best, least, result);
  return result;
}

}  // namespace nilio::core
