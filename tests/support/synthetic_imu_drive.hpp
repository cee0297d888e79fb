#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"

#include <cmath>

namespace nilio::tests {

/// A drive with speed and turns that change; odom is tilted, the IMU lies off the vehicle's centre, and its
/// accelerometer has a bias and measures `scale` times the specific force.
struct SyntheticImuDrive {
  core::SE3 T_base_imu{core::so3_exp(core::Vector3(0.2, -0.1, 0.4)), core::Vector3(-0.8, 0.3, 0.9)};
  Eigen::Quaterniond tilt = core::so3_exp(core::Vector3(0.02, -0.03, 0.0));
  double scale = 1.0;

  static double speed(double t) { return 10.0 + 3.0 * std::sin(0.8 * t); }
  static double rate(double t) { return 0.3 * std::sin(0.5 * t); }
  static double yaw(double t) { return 0.6 * (1.0 - std::cos(0.5 * t)); }
  static Eigen::Quaterniond rotation(double t) { return core::so3_exp(core::Vector3(0.0, 0.0, yaw(t))); }

  [[nodiscard]] core::ImuSample sample(double t) const {
    using core::Vector3;
    const Vector3 turn(0.0, 0.0, rate(t));
    const Vector3 turning(0.0, 0.0, 0.15 * std::cos(0.5 * t));
    const Vector3& arm = T_base_imu.translation;
    const Vector3 up = rotation(t).conjugate() * (tilt * Vector3(0.0, 0.0, 9.81));
    const Vector3 force = Vector3(2.4 * std::cos(0.8 * t), rate(t) * speed(t), 0.0) + turning.cross(arm) +
                          turn.cross(turn.cross(arm)) + up + Vector3(0.02, -0.01, 0.03);
    const Vector3 gyro = T_base_imu.rotation.conjugate() * turn;
    const Vector3 measured = scale * (T_base_imu.rotation.conjugate() * force);
    return {core::Time::from_seconds(t),
            {gyro.x(), gyro.y(), gyro.z()},
            {measured.x(), measured.y(), measured.z()}};
  }
};

}  // namespace nilio::tests
