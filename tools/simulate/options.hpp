#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tools/commands/command_line_fwd.hpp"
#include "tools/simulate/scenes/scene.hpp"
#include "tools/simulate/sensors/gps_reception.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools {

/// Options in the units that data sheets use.
struct SimulateArguments {
  std::string output;
  std::string sensor = "vlp16";
  /// See return_mode_of() and gps_of().
  std::string return_mode = "single";
  std::string gps = "locked";
  double clock_offset_s = 0.0;
  double clock_drift_ppm = 0.0;
  double network_jitter_us = 0.0;
  /// "on", "off", empty = as the model does.
  std::string stream_calibration;
  /// One of simulation::scene_infos().
  std::string scene = "town";
  bool tunnel_lamps = false;
  std::string trajectory = "town";
  std::string calibration;
  double pose_interval_s = 0.1037;
  simulation::DriveExtent extent;
  /// Nothing: the scene's own.
  std::optional<double> speed_m_s;
  bool moving_start = false;
  double revolutions_per_minute = 600.0;
  double range_noise_m = 0.02;
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
  std::vector<std::string> imu_faults;
  double scene_density = 1.0;
  std::optional<unsigned> moving_cars;
  std::uint64_t seed = 1;
};

/// Nothing for a name that is no sensor's.
std::optional<drivers::VelodyneModel> parse_sensor(const std::string& name);
/// Of arguments that were parsed.
drivers::ReturnMode return_mode_of(const SimulateArguments& arguments);
simulation::GpsReception gps_of(const SimulateArguments& arguments);
const simulation::SceneInfo& scene_of(const SimulateArguments& arguments);
/// Declares the options of "nilio simulate"; `arguments` must outlive `command`.
void add_simulate_options(CLI::App& command, SimulateArguments& arguments);
/// An option that the chosen scene, trajectory or LiDAR does not use is a mistake, not something to pass
/// over.
std::optional<core::Error> find_useless_option(const CLI::App& command, const SimulateArguments& arguments);

}  // namespace nilio::tools
