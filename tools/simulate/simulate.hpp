#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tools/simulate/realism.hpp"
#include "tools/simulate/scenes/scene.hpp"
#include "tools/simulate/sensors/imu_grade.hpp"
#include "tools/simulate/sensors/sensor_timing.hpp"
#include "tools/simulate/sensors/weather.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::simulate {

/// Options of "nilio simulate", in the units of data sheets.
struct Options {
  /// Folder for the recording, created if missing.
  std::string output;

  SceneKind scene = SceneKind::kTown;
  bool tunnel_lamps = false;
  /// "town", or a KITTI pose file to drive along; then its calibration (empty = built-in) and interval.
  std::string trajectory = "town";
  std::string calibration;
  double pose_interval_s = 0.1037;
  DriveExtent extent;
  /// Unset = the scene's own.
  std::optional<double> speed_m_s;
  bool moving_start = false;
  double scene_density = 1.0;
  /// Maximum number; unset = the scene's own.
  std::optional<unsigned> moving_cars;

  drivers::VelodyneModel sensor = drivers::VelodyneModel::kVlp16;
  /// Mounting on the vehicle, T_base_lidar: x, y, z (m), roll, pitch, yaw (deg).
  std::array<double, 6> lidar_extrinsic{0.0, 0.0, 1.73, 0.0, 0.0, 0.0};
  /// The LiDAR is mounted at lidar_extrinsic * mounting_error; nilio.yaml does not contain the error.
  std::array<double, 6> mounting_error{};
  drivers::ReturnMode return_mode = drivers::ReturnMode::kSingle;
  double revolutions_per_minute = 600.0;
  double range_noise_m = 0.02;
  GpsReception gps = GpsReception::kLocked;
  double clock_offset_s = 0.0;
  double clock_drift_ppm = 0.0;
  double network_jitter_us = 0.0;
  /// Whether an HDL-64E sends its calibration; unset = S2.1 and S3 do.
  std::optional<bool> stream_calibration;

  /// Name of a built-in preset, or "none".
  std::string imu = "xsens_mti";
  double imu_rate_hz = 200.0;
  double gyro_noise_deg_s = 0.007;
  double gyro_bias_deg_s = 0.1;
  double gyro_drift_deg_h = 10.0;
  double gyro_scale_percent = 0.2;
  double accel_noise_ug = 120.0;
  double accel_bias_m_s2 = 0.02;
  double accel_drift_ug = 30.0;
  double accel_scale_percent = 0.2;
  /// See parse_imu_faults().
  std::vector<std::string> imu_faults;

  /// Unset = industrial if typical, automotive if poor; ideal: the constants above.
  std::optional<ImuGrade> imu_grade;
  /// Use the constants above whatever the realism.
  bool imu_constants = false;
  /// Mounting of the IMU as lidar_extrinsic.
  std::array<double, 6> imu_extrinsic{-0.81, 0.32, 0.93, 0.5, -0.3, 0.8};

  Realism realism = Realism::kTypical;
  /// These effects alone; unset = all, or none if ideal.
  std::optional<Effects> effects;
  Weather weather;
  /// Sector straight ahead that dirt covers, degrees.
  double dirt_deg = 0.0;

  std::uint64_t seed = 1;
  /// The town of `seed` at another time: other traffic, parked cars, sensor unit and noise, 20 % of the
  /// objects changed.
  std::optional<std::uint64_t> visit;
  /// Drive the route backwards, in the oncoming lane.
  bool way_back = false;
};

/// Seed of all that differs from one visit to the next.
inline std::uint64_t visit_seed(const Options& options) { return options.visit.value_or(options.seed); }
/// Effects and IMU grade (unset = constants) that the options stand for.
Effects effects_of(const Options& options);
std::optional<ImuGrade> imu_grade_of(const Options& options);

/// Writes lidar.pcap, imu.candump.log, truth.tum, nilio.yaml, and calibration.yaml if the LiDAR sends its
/// calibration; files in the folder are replaced. Prints a summary on standard output and the progress and
/// warnings on standard error. The same options give the same bytes.
core::Result<bool> write_recording(const Options& options);

}  // namespace nilio::tools::simulate
