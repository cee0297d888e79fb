#pragma once

#include "nilio/core/imu_health.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"
#include "nilio/core/units.hpp"

#include "core/src/estimation/imu_buffer.hpp"
#include "core/src/imu_monitor/accelerometer_alignment.hpp"
#include "core/src/imu_monitor/gyro_alignment.hpp"
#include "core/src/imu_monitor/gyro_consistency.hpp"
#include "core/src/imu_monitor/signal_statistics.hpp"

#include <array>
#include <cstddef>

namespace nilio::core {

struct ImuMonitorConfig {
  /// Position of the IMU in base_link, m.
  Vector3 imu_position = Vector3::Zero();
  Duration max_gap = Duration::from_milliseconds(60.0);
};

/// Motion of base_link between two registered poses.
struct RegisteredMotion {
  Time from;
  Time to;
  SE3 T_odom_from;
  SE3 T_odom_to;
  bool shows_rotation = true;  ///< the scan observed the rotation about every axis

  [[nodiscard]] double seconds() const { return (to - from).seconds(); }
  /// Mean angular velocity in axes of base_link at `from`, rad/s.
  [[nodiscard]] Vector3 mean_rate() const {
    return so3_log(T_odom_from.rotation.conjugate() * T_odom_to.rotation) / seconds();
  }
};

/// Compares an IMU with the motion that the LiDAR registers: decides whether it is used, and diagnoses its
/// faults. All statistics are sums with exponential forgetting: bounded memory, constant cost, and results
/// that depend on the data alone. Not thread-safe.
class ImuMonitor {
 public:
  explicit ImuMonitor(const ImuMonitorConfig& config);

  /// Adds a sample that the buffer accepted, in the IMU's own axes and with its own stamp.
  void add(const ImuSample& sample);
  /// Estimated time offset, subtracted from the IMU's stamps. The remainder is estimated in the next minute
  /// of turning.
  [[nodiscard]] Duration time_shift() const { return shift_; }

  /// Whether the gyro is used for the motion in [from, to]: consistent, and neither stuck nor clipped
  /// there.
  [[nodiscard]] bool usable(Time from, Time to) const;
  /// Whether turns have shown that scale and axes of the gyro are right.
  [[nodiscard]] double scale_deviation() const { return gyro_consistency_.scale_deviation(); }
  /// Whether the accelerometer is used: gravity and the gyro agree with the configured mounting, and it is
  /// neither stuck nor has it clipped since.
  [[nodiscard]] bool force_usable(Time since) const;
  /// Whether the registered motion contradicts the gyro so clearly that the scan should be registered again
  /// without it.
  [[nodiscard]] bool contradicts(const ImuBuffer& imu, const Vector3& gyro_bias,
                                 const RegisteredMotion& motion) const;
  /// Rejects the gyro because of a contradiction.
  void demote();
  /// Angular rate of the last registered motion, rad/s; the constant-rate prediction starts from it.
  [[nodiscard]] const Vector3& registered_rate() const { return gyro_consistency_.registered_rate(); }

  /// Evaluates a scan whose registration was accepted; `gyro_bias` is the bias in use. Where time_shift()
  /// changes, the stamps of the samples in `imu` have to be moved by the change.
  void observe(const ImuBuffer& imu, const Vector3& gyro_bias, const RegisteredMotion& motion);
  /// Skips a scan whose pose is no measurement.
  void skip();

  [[nodiscard]] const ImuHealth& health() const { return health_; }

 private:
  // A sensor at rest or in calm motion never clips below these full scales, rad/s and m/s^2.
  static constexpr double kMinGyroFullScale = 5.0 * kRadiansPerDegree;
  static constexpr double kMinAccelFullScale = 12.0;
  // Values unchanged for longer count as stuck; single repeats are normal.
  static constexpr Duration kStuckAfter = Duration::from_milliseconds(100.0);
  // Motions waiting for the samples of the largest shift: two scans at 20 Hz more than that takes.
  static constexpr std::size_t kPending = 8;

  void compare_with_registration(const ImuBuffer& imu, const Vector3& gyro_bias,
                                 const RegisteredMotion& motion);
  void process_pending(const ImuBuffer& imu);
  void fit_time_shifts(const ImuBuffer& imu, const RegisteredMotion& motion);
  [[nodiscard]] bool signal_is_sound(Time from, Time to) const;
  [[nodiscard]] bool force_is_sound(Time since) const {
    return accel_.unchanged() < kStuckAfter && !accel_.clipped_since(since);
  }
  void fill_table(Time now);
  void fill_signals(Time now);
  void fill_rotation();
  void fill_offset(const GyroAlignmentEstimate& estimate);
  void fill_bias();
  void follow_offset(const GyroAlignmentEstimate& estimate);
  void fill_force();
  void reject(ImuCheck reason);

  ImuMonitorConfig config_;
  TriadSignal gyro_{kMinGyroFullScale};
  TriadSignal accel_{kMinAccelFullScale};
  SampleTiming timing_;
  GyroAlignment rotation_;
  AccelerometerAlignment force_;
  GyroConsistency gyro_consistency_;
  ImuHealth health_;

  std::array<RegisteredMotion, kPending> pending_{};
  std::size_t first_pending_ = 0;
  std::size_t pending_count_ = 0;
  Duration shift_;
  Vector3 bias_sum_ = Vector3::Zero();
  double bias_weight_ = 0.0;
};

}  // namespace nilio::core
