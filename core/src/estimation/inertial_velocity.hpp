#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "core/src/estimation/accelerometer_consistency.hpp"
#include "core/src/estimation/imu_buffer.hpp"
#include "core/src/imu_monitor/imu_monitor.hpp"

#include <optional>

namespace nilio::core {

/// Angular rate of base_link in its own axes, rad/s: from the gyro, or constant where the gyro is not used.
struct TurnRate {
  const ImuBuffer& imu;
  Vector3 gyro_bias = Vector3::Zero();
  std::optional<Vector3> held;

  [[nodiscard]] Vector3 at(Time time) const {
    return held ? *held : Vector3(imu.angular_velocity_at(time) - gyro_bias);
  }
};

/// IMU integration over a span, in fixed axes.
struct ImuIncrement {
  Vector3 velocity = Vector3::Zero();  ///< integral of the specific force, m/s
  Eigen::Quaterniond rotation;         ///< of base_link at the end
};

/// Integrates from `from`, where base_link has attitude `rotation`; the buffer must cover the span.
ImuIncrement integrate_imu(const TurnRate& rate, Time from, Time to, const Eigen::Quaterniond& rotation);

/// Acceleration of base_link from the accelerometer, once that predicts the scans' velocities better than a
/// constant velocity does. Needs neither bias nor levelled axes (AccelerometerConsistency). Not thread-safe.
class InertialVelocity {
 public:
  /// Position of the IMU in base_link, m, and the longest gap between samples of one motion.
  InertialVelocity(const Vector3& imu_position, Duration max_gap)
      : imu_position_(imu_position), max_gap_(max_gap) {}

  /// Mean rate of change of the body velocity over [from, to], m/s^2, given `rotation` and `velocity` at
  /// `from`. Empty where the accelerometer is not used.
  [[nodiscard]] std::optional<Vector3> acceleration(const TurnRate& rate, Time from, Time to,
                                                    const Eigen::Quaterniond& rotation,
                                                    const Vector3& velocity) const;
  /// Updates the consistency test with a registered motion and its body velocity; `share` is the
  /// observability along each axis, 0 to 1. `only_weigh` as in AccelerometerConsistency::Evidence.
  void update(const TurnRate& rate, const RegisteredMotion& motion, const Vector3& velocity,
              const Vector3& share, bool only_weigh);
  /// Sets the gravity and bias vector that is subtracted from the specific force.
  void set_gravity_bias(const Vector3& gravity_bias, double variance) {
    consistency_.set_gravity_bias(gravity_bias, variance);
  }
  [[nodiscard]] const AccelerometerConsistency& consistency() const { return consistency_; }
  /// Resets the consistency test.
  void reset() {
    consistency_ = {};
    last_.reset();
  }
  /// Marks a discontinuity of the motion.
  void interrupt() { last_.reset(); }

 private:
  struct Past {
    Time time;
    Eigen::Quaterniond rotation;
    Vector3 velocity;      ///< in axes of base_link
    Vector3 imu_velocity;  ///< in the axes that `rotation` is to
  };

  Vector3 imu_position_;
  Duration max_gap_;
  AccelerometerConsistency consistency_;
  std::optional<Past> last_;
};

}  // namespace nilio::core
