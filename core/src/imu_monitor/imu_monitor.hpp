#pragma once

#include "nilio/core/imu_health.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "core/src/estimation/imu_buffer.hpp"

#include <memory>

namespace nilio::core {

struct ImuMonitorConfig {
  /// Where the IMU is on base_link, m.
  Vector3 imu_position = Vector3::Zero();
  Duration max_gap = Duration::from_milliseconds(150.0);
};

/// Motion of base_link between two registered poses.
struct RegisteredMotion {
  Time from;
  Time to;
  SE3 T_odom_from;
  SE3 T_odom_to;

  [[nodiscard]] double seconds() const { return (to - from).seconds(); }
  /// Mean angular velocity in axes of base_link at `from`, rad/s.
  [[nodiscard]] Vector3 mean_rate() const {
    return so3_log(T_odom_from.rotation.conjugate() * T_odom_to.rotation) / seconds();
  }
};

/// Judges an IMU by the motion that the LiDAR registers: whether it may be used, and what is wrong with it.
/// Everything is a sum with fading memory, so memory is bounded and a scan costs the same at any time; what
/// comes out depends on the data alone. Not thread-safe.
class ImuMonitor {
 public:
  explicit ImuMonitor(const ImuMonitorConfig& config);
  ImuMonitor(ImuMonitor&&) noexcept;
  ImuMonitor& operator=(ImuMonitor&&) noexcept;
  ImuMonitor(const ImuMonitor&) = delete;
  ImuMonitor& operator=(const ImuMonitor&) = delete;
  ~ImuMonitor();

  /// Each sample that the buffer took, in the IMU's own axes and with its own stamp.
  void add(const ImuSample& sample);
  /// To be subtracted from the IMU's stamps: the time offset, once it is known. What is left of it shows in
  /// the next minute of turning.
  [[nodiscard]] Duration time_shift() const;

  /// Whether the gyro may be used for the motion in [from, to]: it is trusted, and neither stuck nor clipped
  /// there.
  [[nodiscard]] bool usable(Time from, Time to) const;
  /// Whether the accelerometer may be used: gravity and the gyro say that it is mounted as configured, and it
  /// is neither stuck nor has it clipped since.
  [[nodiscard]] bool force_usable(Time since) const;
  /// Whether the registered motion contradicts the gyro so plainly that this scan had better be registered
  /// without it.
  [[nodiscard]] bool contradicts(const ImuBuffer& imu, const Vector3& gyro_bias,
                                 const RegisteredMotion& motion) const;
  /// Withdraws trust because of a contradiction.
  void demote();
  /// The rate of the last registered motion, rad/s: what a constant rate would predict from.
  [[nodiscard]] const Vector3& registered_rate() const;

  /// Each scan whose registration was accepted; `gyro_bias` is what the user of the gyro subtracts. True when
  /// time_shift() has changed, so that the samples in `imu` have stamps of before and had better go.
  bool observe(const ImuBuffer& imu, const Vector3& gyro_bias, const RegisteredMotion& motion);
  /// A scan whose pose is no measurement.
  void skip();

  [[nodiscard]] const ImuHealth& health() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace nilio::core
