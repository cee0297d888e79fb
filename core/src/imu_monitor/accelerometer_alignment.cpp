#include "core/src/imu_monitor/accelerometer_alignment.hpp"

#include "nilio/core/units.hpp"

#include "core/src/linear_algebra.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

constexpr double kForceMemory = 1.0 - 1.0 / 600.0;
constexpr double kSteadyMemory = 1.0 - 1.0 / 100.0;
constexpr double kMinForceWeight = 50.0;
constexpr double kMinSteadyWeight = 30.0;
constexpr double kSteadyAcceleration = 1.0;
constexpr double kUnevenness = 0.1;
constexpr double kLargestMountingSigma = kRadiansPerDegree;
// Successive windows share all but one scan: only one in so many is independent.
constexpr double kOverlap = 10.0;

}  // namespace

const AccelerometerAlignment::Record& AccelerometerAlignment::record(std::size_t i) const {
  return records_[(next_ + i) % records_.size()];
}

bool AccelerometerAlignment::evenly_spaced() const {
  const double mean = (record(2 * kSpan).time - record(0).time).seconds() / (2.0 * kSpan);
  for (std::size_t i = 0; i < 2 * kSpan; ++i) {
    const double interval = (record(i + 1).time - record(i).time).seconds();
    if (std::abs(interval - mean) > kUnevenness * mean) return false;
  }
  return true;
}

void AccelerometerAlignment::add(Time time, const SE3& T_odom_base, const Vector3& imu_position,
                                 const Vector3& force) {
  records_[next_] = {time, T_odom_base.rotation.toRotationMatrix(), imu_position, force};
  next_ = (next_ + 1) % records_.size();
  count_ = std::min(count_ + 1, records_.size());
  if (count_ == records_.size() && evenly_spaced()) update();
}

void AccelerometerAlignment::update() {
  const double span = 0.5 * (record(2 * kSpan).time - record(0).time).seconds();
  const Vector3 acceleration =
      (record(2 * kSpan).position - 2.0 * record(kSpan).position + record(0).position) / (span * span);
  // A second difference of positions weights acceleration by a triangle; the specific force is weighted
  // alike.
  Matrix36 design = Matrix36::Zero();
  Vector3 target = acceleration;
  for (std::size_t i = 1; i <= 2 * kSpan; ++i) {
    const double distance = static_cast<double>(std::min(i, 2 * kSpan + 1 - i)) - 0.5;
    const double weight = distance / static_cast<double>(kSpan * kSpan);
    const Record& r = record(i);
    const Matrix3 R_middle = 0.5 * (record(i - 1).R_odom_base + r.R_odom_base);
    target -= weight * (R_middle * r.force);
    design.leftCols<3>() -= weight * (R_middle * skew(r.force));
  }
  design.rightCols<3>() = -Matrix3::Identity();
  information_ = kForceMemory * information_ + design.transpose() * design;
  right_side_ = kForceMemory * right_side_ + design.transpose() * target;
  squares_ = kForceMemory * squares_ + target.squaredNorm();
  weight_ = kForceMemory * weight_ + 1.0;
  update_steady(acceleration);
}

void AccelerometerAlignment::update_steady(const Vector3& acceleration) {
  if (acceleration.norm() > kSteadyAcceleration) return;
  steady_ = kSteadyMemory * steady_ + record(2 * kSpan).force;
  steady_weight_ = kSteadyMemory * steady_weight_ + 1.0;
}

AccelerometerAlignmentEstimate AccelerometerAlignment::estimate() const {
  AccelerometerAlignmentEstimate result;
  result.steady_known = steady_weight_ >= kMinSteadyWeight;
  if (result.steady_known) result.steady = steady_ / steady_weight_;
  if (weight_ < kMinForceWeight) return result;
  const Matrix6 information = information_ + 1e-6 * Matrix6::Identity();
  const Vector6 solution = solve_ldlt(information, right_side_);
  const Matrix6 inverse = inverse_ldlt(information);
  const double residual = std::max(0.0, squares_ - solution.dot(right_side_));
  const double variance = kOverlap * residual / (3.0 * weight_);
  for (Eigen::Index i = 0; i < 3; ++i) {
    if (std::sqrt(variance * inverse(i, i)) > kLargestMountingSigma) continue;
    result.mounting[i] = solution[i];
    result.mounting_known = true;
  }
  return result;
}

}  // namespace nilio::core
