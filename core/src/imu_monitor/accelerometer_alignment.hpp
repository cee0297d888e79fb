#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <array>
#include <cstddef>

#include <Eigen/Core>

namespace nilio::core {

struct AccelerometerAlignmentEstimate {
  /// Rotation vector from the measured to the true specific force in base_link, rad; unobserved components
  /// are 0.
  Vector3 mounting = Vector3::Zero();
  bool mounting_known = false;
  /// Mean specific force in base_link while not accelerating, m/s^2.
  Vector3 steady = Vector3::Zero();
  bool steady_known = false;
};

/// Fits the accelerometer's mounting to the acceleration of the registered positions. The direction of
/// gravity in odom is estimated jointly, so that neither a slope at the start nor a wrongly levelled odom
/// frame is mistaken for a mounting error. Small angles; memory of one minute.
class AccelerometerAlignment {
 public:
  /// Adds a registered pose, the IMU's position in odom, and the mean specific force since the previous pose
  /// in axes of base_link.
  void add(Time time, const SE3& T_odom_base, const Vector3& imu_position, const Vector3& force);
  /// Marks a discontinuity: positions before and after it are not compared.
  void interrupt() { count_ = 0; }
  [[nodiscard]] AccelerometerAlignmentEstimate estimate() const;

 private:
  /// Scans between the positions of one difference: position noise must be small against 1 m/s^2.
  static constexpr std::size_t kSpan = 5;
  struct Record {
    Time time;
    Matrix3 R_odom_base = Matrix3::Identity();
    Vector3 position = Vector3::Zero();
    Vector3 force = Vector3::Zero();
  };
  using Matrix36 = Eigen::Matrix<double, 3, 6>;

  [[nodiscard]] const Record& record(std::size_t i) const;
  [[nodiscard]] bool evenly_spaced() const;
  void update();
  void update_steady(const Vector3& acceleration);

  std::array<Record, 2 * kSpan + 1> records_{};
  std::size_t next_ = 0;
  std::size_t count_ = 0;
  // Normal equations of mounting and gravity.
  Matrix6 information_ = Matrix6::Zero();
  Vector6 right_side_ = Vector6::Zero();
  double squares_ = 0.0;
  double weight_ = 0.0;
  Vector3 steady_ = Vector3::Zero();
  double steady_weight_ = 0.0;
};

}  // namespace nilio::core
