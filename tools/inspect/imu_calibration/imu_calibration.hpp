#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "core/src/imu_monitor/imu_monitor.hpp"

#include <array>
#include <limits>
#include <span>

namespace nilio::tools::inspect {

/// Configured mounting of the IMU, and the maximum gap within its stream.
struct ImuMounting {
  core::SE3 T_base_imu;
  /// Longer gaps between samples are not interpolated.
  core::Duration max_gap = core::Duration::from_milliseconds(150.0);
};

/// Scale factor of all axes of one sensor.
struct ScaleCorrection {
  bool known = false;
  /// Correction factor; 1 = none.
  double factor = 1.0;
  double sigma = 0.0;
  /// The factor is that of a unit mistake: degrees for radians, g for m/s^2, or the reverse.
  bool is_unit = false;
};

/// Calibration of an IMU against the motion registered from LiDAR: time offset, scales and mounting.
struct ImuCalibration {
  bool time_offset_known = false;
  /// It exceeds the threshold for a correction.
  bool time_offset_matters = false;
  /// IMU stamp minus LiDAR stamp of the same time, s: to be subtracted from the IMU's stamps.
  double time_offset_s = 0.0;
  double time_offset_sigma_s = 0.0;

  ScaleCorrection gyro;
  ScaleCorrection accel;

  /// Rotation from IMU to base_link to be configured.
  Eigen::Quaterniond R_base_imu = Eigen::Quaterniond::Identity();
  /// Axes of the IMU to be negated before that rotation, for mirrored axes.
  std::array<bool, 3> negate_gyro{};
  std::array<bool, 3> negate_accel{};
  /// Rotation or signs differ from the configured ones by more than the standard deviation.
  bool orientation_changed = false;
  /// The change was rounded to an axis permutation.
  bool along_axes = false;
  /// Angle of the fitted rotation before rounding, rad.
  double fitted_angle = 0.0;
  /// Standard deviation about x, y and z of base_link, rad; infinite = not observed, and the configured value
  /// was kept.
  std::array<double, 3> rotation_sigma{std::numeric_limits<double>::infinity(),
                                       std::numeric_limits<double>::infinity(),
                                       std::numeric_limits<double>::infinity()};
  /// All three axes are observed by the accelerometer, so that mirrored axes are distinguished from a
  /// rotation.
  bool mirror_known = false;
  /// Gyroscope and accelerometer result in different axes: no rotation fits both.
  bool axes_disagree = false;

  /// True if there is any correction.
  [[nodiscard]] bool any() const {
    return time_offset_matters || gyro.factor != 1.0 || accel.factor != 1.0 || orientation_changed;
  }
};

/// Largest time offset in the search, s.
inline constexpr double kLargestCorrectableOffset = 1.0;

/// Calibrates the IMU over a whole drive. `samples`: in order of time, in axes, units and stamps as
/// configured. Unobserved quantities and those within the error stay as configured. Gravity and the gyro of a
/// turning car observe only the vertical axis; the forward axis needs the forces of braking and bends, or
/// roll and pitch. Allocates; not for the scan path.
ImuCalibration calibrate_imu(std::span<const core::RegisteredMotion> motions,
                             std::span<const core::ImuSample> samples, const ImuMounting& mounting);

/// Combines a calibration with that of a second run with its correction. The first is not exact, because a
/// wrong gyro degrades deskewing.
ImuCalibration refine(const ImuCalibration& first, const ImuCalibration& rest);

/// [roll, pitch, yaw] about fixed axes (R = Rz Ry Rx), rad; at gimbal lock (pitch +-90 deg) roll is 0.
core::Vector3 roll_pitch_yaw(const core::Matrix3& rotation);

}  // namespace nilio::tools::inspect
