#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "core/src/imu_monitor/imu_monitor.hpp"

#include <array>
#include <limits>
#include <span>

namespace nilio::tools::inspect {

/// How the IMU is configured to be mounted, and which samples are one stream.
struct ImuMounting {
  core::SE3 T_base_imu;
  /// A longer gap between samples is not bridged.
  core::Duration max_gap = core::Duration::from_milliseconds(150.0);
};

/// A factor for all axes of one sensor.
struct ScaleCorrection {
  bool known = false;
  /// To multiply the values by; 1 = they are right.
  double factor = 1.0;
  double sigma = 0.0;
  /// It is that of a usual mistake of units: degrees for radians, g for m/s^2, or the other way round.
  bool is_unit = false;
};

/// What has to be changed so that the IMU agrees with the motion that the LiDAR registers.
struct ImuCalibration {
  bool time_offset_known = false;
  /// Large enough to be corrected.
  bool time_offset_matters = false;
  /// IMU stamps less LiDAR stamps of the same instant, s: to be subtracted from the IMU's stamps.
  double time_offset_s = 0.0;
  double time_offset_sigma_s = 0.0;

  ScaleCorrection gyro;
  ScaleCorrection accel;

  /// Rotation IMU to base_link to configure in place of the present one.
  Eigen::Quaterniond R_base_imu = Eigen::Quaterniond::Identity();
  /// Axes of the IMU to be negated before that rotation: a mirror image is no rotation.
  std::array<bool, 3> negate_gyro{};
  std::array<bool, 3> negate_accel{};
  /// Rotation and signs differ from the configured ones by more than the fit's error.
  bool orientation_changed = false;
  /// What changed are whole axes, to which the fit was near enough.
  bool along_axes = false;
  /// The fitted rotation from present to right axes of base_link, rad, before it was rounded to axes.
  double fitted_angle = 0.0;
  /// One standard deviation about x, y and z of base_link, rad; infinite = the drive does not show it, and
  /// the configured value was kept.
  std::array<double, 3> rotation_sigma{std::numeric_limits<double>::infinity(),
                                       std::numeric_limits<double>::infinity(),
                                       std::numeric_limits<double>::infinity()};
  /// The forces show all three axes, so that a mirror image is told from a rotation.
  bool mirror_known = false;
  /// Gyroscope and accelerometer fit to different axes: no rotation puts both right.
  bool axes_disagree = false;

  /// True when anything is to be changed.
  [[nodiscard]] bool any() const {
    return time_offset_matters || gyro.factor != 1.0 || accel.factor != 1.0 || orientation_changed;
  }
};

/// Largest time offset that is found, s.
inline constexpr double kLargestCorrectableOffset = 1.0;

/// Compares a whole drive's samples (in axes, units and stamps as configured, in order of time) with its
/// registered motions. What the drive does not show stays as it is. Values within the fit's error count as
/// right. Both gravity and a turning car's gyro tell the upright axis only; where forward is, the forces of
/// braking and bends tell, or roll and pitch. Allocates; not for the scan path.
ImuCalibration calibrate_imu(std::span<const core::RegisteredMotion> motions,
                                  std::span<const core::ImuSample> samples, const ImuMounting& mounting);

/// A correction and what was found to be left of it when it was applied, as one: the first cannot be exact,
/// for a gyro that is wrong does not deskew.
ImuCalibration refine(const ImuCalibration& first, const ImuCalibration& rest);

/// [roll, pitch, yaw] about fixed axes (R = Rz Ry Rx), rad; where pitch is upright, roll is 0.
core::Vector3 roll_pitch_yaw(const core::Matrix3& rotation);

}  // namespace nilio::tools::inspect
