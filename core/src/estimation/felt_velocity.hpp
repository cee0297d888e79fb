#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "core/src/estimation/accelerometer_judge.hpp"
#include "core/src/estimation/imu_buffer.hpp"
#include "core/src/imu_monitor/imu_monitor.hpp"

#include <optional>

namespace nilio::core {

/// The rate at which base_link turns, rad/s in its own axes: as the gyro has it, or held where that is not
/// trusted.
struct TurnRate {
  const ImuBuffer& imu;
  Vector3 gyro_bias = Vector3::Zero();
  std::optional<Vector3> held;

  [[nodiscard]] Vector3 at(Time time) const {
    return held ? *held : Vector3(imu.angular_velocity_at(time) - gyro_bias);
  }
};

/// What an IMU feels on its way, in axes that stand still.
struct FeltMotion {
  Vector3 velocity = Vector3::Zero();  ///< integral of the specific force, m/s
  Eigen::Quaterniond rotation;         ///< of base_link at the end
};

/// From a time at which base_link is turned as `rotation` says; the buffer has to cover the span.
FeltMotion felt_between(const TurnRate& rate, Time from, Time to, const Eigen::Quaterniond& rotation);

/// How the velocity of base_link changes by what the accelerometer feels, once that has predicted the scans'
/// velocities better than holding them. Needs no bias and no levelled axes: see AccelerometerJudge. Not
/// thread-safe.
class FeltVelocity {
 public:
  /// The IMU's place on base_link, m, and the longest gap between samples that are one motion.
  FeltVelocity(const Vector3& imu_position, Duration max_gap)
      : imu_position_(imu_position), max_gap_(max_gap) {}

  /// Mean rate of change of the velocity of base_link in its own axes, m/s^2, when that is `velocity` and
  /// turned as `rotation` at `from`. Empty where the accelerometer is not followed.
  [[nodiscard]] std::optional<Vector3> acceleration(const TurnRate& rate, Time from, Time to,
                                                    const Eigen::Quaterniond& rotation,
                                                    const Vector3& velocity) const;
  /// A registered motion and its velocity in axes of base_link, of which the scan showed `share`, 0 to 1,
  /// along each. `only_weigh` as in AccelerometerJudge::Evidence.
  void learn(const TurnRate& rate, const RegisteredMotion& motion, const Vector3& velocity,
             const Vector3& share, bool only_weigh);
  /// What AccelerometerJudge subtracts from what is felt.
  void know_support(const Vector3& support, double variance) { judge_.know_support(support, variance); }
  [[nodiscard]] const AccelerometerJudge& judge() const { return judge_; }
  /// As if nothing had been learnt: the accelerometer has to show anew that it helps.
  void reset() {
    judge_ = {};
    last_.reset();
  }
  /// What follows does not go on from the motion before.
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
  AccelerometerJudge judge_;
  std::optional<Past> last_;
};

}  // namespace nilio::core
