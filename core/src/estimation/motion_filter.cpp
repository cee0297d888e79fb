#include "core/src/estimation/motion_filter.hpp"

#include "core/src/registration/gauss_newton.hpp"

#include <cmath>

namespace nilio::core {

namespace {

// Position variance is capped at the scan's: position is relative to the local map.
constexpr double kPositionVariance = kScanErrorMetres * kScanErrorMetres;
// Residual acceleration error from axes, scale and sampling: a hundredth of 1 g.
constexpr double kAccelerationVariance = 0.1 * 0.1;
// Attitude drift that misaligns gravity: less than 0.1 deg in a second.
constexpr double kGravityBiasVariancePerSecond = 0.0002;
// An accelerometer bias of 0.1 m/s^2 turns with the vehicle's heading.
constexpr double kGravityBiasVariancePerRadian = 0.1 * 0.1;
// Threshold: three standard deviations over some scans.
constexpr double kInnovationMemory = 0.8;
constexpr double kMaxNormalisedSquare = 9.0;
constexpr double kMinInnovations = 1.0;

}  // namespace

void MotionFilter::begin(const Variances& variances) {
  covariance_.setZero();
  covariance_.diagonal() << Vector3::Constant(kPositionVariance), Vector3::Constant(variances.velocity),
      Vector3::Constant(variances.gravity_bias);
  normalised_squares_ = 0.0;
  innovations_ = 0.0;
  has_begun_ = true;
}

void MotionFilter::advance(double seconds, double turn_rad) {
  const Matrix3 I = Matrix3::Identity();
  const double square = seconds * seconds;
  Matrix9 F = Matrix9::Identity();
  F.block<3, 3>(0, 3) = seconds * I;
  F.block<3, 3>(0, 6) = -0.5 * square * I;
  F.block<3, 3>(3, 6) = -seconds * I;
  covariance_ = (F * covariance_ * F.transpose()).eval();
  covariance_.block<3, 3>(0, 0) += 0.25 * kAccelerationVariance * square * square * I;
  covariance_.block<3, 3>(0, 3) += 0.5 * kAccelerationVariance * square * seconds * I;
  covariance_.block<3, 3>(3, 0) += 0.5 * kAccelerationVariance * square * seconds * I;
  covariance_.block<3, 3>(3, 3) += kAccelerationVariance * square * I;
  covariance_.block<3, 3>(6, 6) +=
      (kGravityBiasVariancePerSecond * seconds + kGravityBiasVariancePerRadian * std::abs(turn_rad)) * I;
}

Vector3 MotionFilter::position_variance(const Matrix3& R_odom_base) const {
  return (R_odom_base.transpose() * covariance_.block<3, 3>(0, 0) * R_odom_base).diagonal();
}

Vector3 MotionFilter::velocity_gain(const Matrix3& R_odom_base) const {
  const Vector3 common = (R_odom_base.transpose() * covariance_.block<3, 3>(3, 0) * R_odom_base).diagonal();
  return common.cwiseQuotient(position_variance(R_odom_base));
}

Vector3 MotionFilter::correct(const Matrix3& R_odom_base, const Vector3& moved, const Vector3& share) {
  // Sequential update: one axis after the other.
  Vector9 change = Vector9::Zero();
  normalised_squares_ = kInnovationMemory * normalised_squares_ +
                        moved.cwiseAbs2().cwiseQuotient(position_variance(R_odom_base)).sum();
  innovations_ = kInnovationMemory * innovations_ + share.sum();
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3 direction = R_odom_base.col(axis);
    const Vector9 common = covariance_.leftCols<3>() * direction;
    const double variance = direction.dot(common.head<3>());
    change += common * ((moved[axis] - direction.dot(change.head<3>())) / variance);
    covariance_ -= common * common.transpose() * (share[axis] / variance);
  }
  for (int axis = 0; axis < 3; ++axis) bound_position(R_odom_base.col(axis));
  covariance_ = (0.5 * (covariance_ + covariance_.transpose())).eval();
  return change.tail<3>();
}

bool MotionFilter::is_contradicted() const {
  return innovations_ > kMinInnovations && normalised_squares_ > kMaxNormalisedSquare * innovations_;
}

void MotionFilter::bound_position(const Vector3& direction) {
  const double variance = direction.dot(covariance_.block<3, 3>(0, 0) * direction);
  if (variance <= kPositionVariance) return;
  Matrix9 shrink = Matrix9::Identity();
  shrink.block<3, 3>(0, 0) -=
      (1.0 - std::sqrt(kPositionVariance / variance)) * direction * direction.transpose();
  covariance_ = (shrink * covariance_ * shrink.transpose()).eval();
}

}  // namespace nilio::core
