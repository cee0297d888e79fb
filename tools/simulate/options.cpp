#include "tools/simulate/options.hpp"

#include "nilio/drivers/imu/mapping.hpp"

#include "tools/commands/number_between.hpp"
#include "tools/simulate/faults/imu_faults.hpp"
#include "tools/simulate/sensors/hdl64e_stream.hpp"

#include <algorithm>
#include <sstream>
#include <utility>
#include <vector>

namespace nilio::tools {

using core::Error;
using simulation::GpsReception;

namespace {

// In the order in which help and messages name them.
const std::vector<std::pair<std::string, drivers::ReturnMode>> kReturnModes{
    {"single", drivers::ReturnMode::kSingle},
    {"dual", drivers::ReturnMode::kDual},
    {"dual_confidence", drivers::ReturnMode::kDualConfidence}};
const std::vector<std::pair<std::string, GpsReception>> kGpsReceptions{
    {"locked", GpsReception::kLocked}, {"nmea", GpsReception::kNmeaOnly}, {"none", GpsReception::kNone}};

template <class Value>
std::vector<std::string> names_of(const std::vector<std::pair<std::string, Value>>& values) {
  std::vector<std::string> names;
  names.reserve(values.size());
  for (const auto& [name, value] : values) names.push_back(name);
  return names;
}

/// `fallback` for a name that is not there.
template <class Value>
Value value_of(const std::vector<std::pair<std::string, Value>>& values, const std::string& wanted,
               Value fallback) {
  for (const auto& [name, value] : values) {
    if (name == wanted) return value;
  }
  return fallback;
}

std::string sensor_names() {
  std::string names;
  for (const drivers::VelodyneModel model : drivers::velodyne_models())
    names += std::string(drivers::velodyne_model_name(model)) + ", ";
  return names + "or 'hdl64e' for HDL-64E-S2";
}

CLI::Validator sensor_name() {
  const auto check = [](std::string& given) {
    return parse_sensor(given) ? std::string() : "'" + given + "' is not one of " + sensor_names();
  };
  return {check, ""};
}

std::vector<std::string> scene_names() {
  std::vector<std::string> names;
  for (const simulation::SceneInfo& info : simulation::scene_infos()) names.emplace_back(info.name);
  return names;
}

std::string describe_scenes() {
  std::string text = "where to drive:";
  for (const simulation::SceneInfo& info : simulation::scene_infos())
    text += std::string("\n") + info.name + ": " + info.summary;
  return text + "\n";
}

void add_drive_options(CLI::App& command, SimulateArguments& a) {
  command.add_option("--scene", a.scene, describe_scenes())
      ->check(CLI::IsMember(scene_names()))
      ->capture_default_str();
  command.add_flag("--tunnel-lamps", a.tunnel_lamps, "lamps and niches in the tunnel, which is bare without");
  command
      .add_option("--trajectory", a.trajectory,
                  "'town', or a KITTI pose file (camera poses, 12 numbers a line) to drive along")
      ->capture_default_str();
  command.add_option("--calib", a.calibration,
                     "KITTI calib.txt with Tr for the pose file; without it that of sequences 00-02");
  command.add_option("--pose-interval", a.pose_interval_s, "seconds from pose to pose in the pose file")
      ->check(number_between(0.001, 10.0))
      ->capture_default_str();
  command.add_option("--length", a.extent.length_m, "metres to drive; default: the whole drive")
      ->check(number_between(1.0, 100000.0));
  command.add_option("--duration", a.extent.duration_s, "seconds to drive; default: the whole drive")
      ->check(number_between(0.5, 7200.0));
  command
      .add_option(
          "--speed", a.speed_m_s,
          "cruising speed, m/s; default: town 10, highway 30, tunnel 20, ramps 5, forest 6, manoeuvres 14")
      ->check(number_between(0.5, 40.0));
  command.add_flag("--moving-start", a.moving_start,
                   "begin at speed instead of standing for 2 s; before the tunnel it always does");
}

void add_lidar_options(CLI::App& command, SimulateArguments& a) {
  command.add_option("--sensor", a.sensor, "LiDAR: " + sensor_names())
      ->check(sensor_name())
      ->capture_default_str();
  command.add_option("--return-mode", a.return_mode, "returns in each packet")
      ->check(CLI::IsMember(names_of(kReturnModes)))
      ->capture_default_str();
  command.add_option("--rpm", a.revolutions_per_minute, "revolutions per minute")
      ->check(number_between(300.0, 1200.0))
      ->capture_default_str();
  command.add_option("--range-noise", a.range_noise_m, "standard deviation of a range, m")
      ->check(number_between(0.0, 1.0))
      ->capture_default_str();
  command
      .add_option("--scene-density", a.scene_density,
                  "scales the number of buildings, trees, parked cars and posts")
      ->check(number_between(0.0, 3.0))
      ->capture_default_str();
  command
      .add_option("--moving-cars", a.moving_cars,
                  "how many at most; default: one per 30 m in the town, elsewhere what is usual there")
      ->check(number_between(0.0, 5000.0));
}

void add_clock_options(CLI::App& command, SimulateArguments& a) {
  command
      .add_option("--gps", a.gps, "what the LiDAR has of a GPS receiver: pulse and time, time only, nothing")
      ->check(CLI::IsMember(names_of(kGpsReceptions)))
      ->capture_default_str();
  command.add_option("--sensor-clock-offset-s", a.clock_offset_s, "LiDAR's clock less the host's, s")
      ->check(number_between(-1e6, 1e6))
      ->capture_default_str();
  command
      .add_option("--sensor-clock-drift-ppm", a.clock_drift_ppm, "how much faster it runs, parts per million")
      ->check(number_between(-1000.0, 1000.0))
      ->capture_default_str();
  command
      .add_option("--network-jitter-us", a.network_jitter_us, "longest delay of a packet beyond the shortest")
      ->check(number_between(0.0, 20000.0))
      ->capture_default_str();
  command
      .add_option("--stream-calibration", a.stream_calibration,
                  "whether an HDL-64E sends its calibration (rounded as the stream has it, and written to "
                  "calibration.yaml); default: S2.1 and S3 do")
      ->check(CLI::IsMember({"on", "off"}));
}

/// The presets that have all six axes, and "none".
std::vector<std::string> imu_names() {
  std::vector<std::string> names;
  for (const std::string& name : drivers::imu_preset_names()) {
    const core::Result<drivers::ImuPreset> preset = drivers::imu_preset(name);
    if (preset && drivers::missing_axes(preset->mapping).empty()) names.push_back(name);
  }
  names.emplace_back("none");
  return names;
}

void add_imu_options(CLI::App& command, SimulateArguments& a) {
  command.add_option("--imu", a.imu, "IMU and its CAN frames")
      ->check(CLI::IsMember(imu_names()))
      ->capture_default_str();
  command.add_option("--imu-rate", a.imu_rate_hz, "samples per second")
      ->check(number_between(10.0, 1000.0))
      ->capture_default_str();
  const auto add_error = [&](const char* name, double& value, const char* help) {
    command.add_option(name, value, help)->check(number_between(0.0, 1e6))->capture_default_str();
  };
  add_error("--gyro-noise", a.gyro_noise_deg_s, "deg/s/sqrt(Hz)");
  add_error("--gyro-bias", a.gyro_bias_deg_s, "constant bias of each axis, deg/s");
  add_error("--gyro-drift", a.gyro_drift_deg_h, "in-run bias, deg/h");
  add_error("--gyro-scale", a.gyro_scale_percent, "error of each axis's scale, %");
  add_error("--accel-noise", a.accel_noise_ug, "micro-g/sqrt(Hz)");
  add_error("--accel-bias", a.accel_bias_m_s2, "constant bias of each axis, m/s^2");
  add_error("--accel-drift", a.accel_drift_ug, "in-run bias, micro-g");
  add_error("--accel-scale", a.accel_scale_percent, "error of each axis's scale, %");
  command
      .add_option(
          "--imu-fault", a.imu_faults,
          "what is wrong with the IMU; may be given several times:\n" + simulation::describe_imu_faults())
      ->allow_extra_args(false)
      ->type_name("NAME[=VALUE]");
}

/// What the chosen LiDAR cannot do.
std::optional<Error> find_impossible_option(const CLI::App& command, const SimulateArguments& a) {
  const auto model = parse_sensor(a.sensor);
  if (!model) return std::nullopt;
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(*model);
  if (sensor.layout(return_mode_of(a)) == nullptr) {
    std::string modes;
    for (const auto& [name, mode] : kReturnModes) {
      if (sensor.layout(mode) != nullptr) modes += (modes.empty() ? "" : ", ") + name;
    }
    return Error{"--return-mode: " + sensor.name + " has only " + modes};
  }
  if (!a.stream_calibration.empty() && !simulation::has_status_stream(*model))
    return Error{"--stream-calibration: " + sensor.name +
                 " sends no calibration; an HDL-64E-S2 or later does"};
  for (const char* name : {"--gps", "--sensor-clock-offset-s", "--sensor-clock-drift-ppm"}) {
    if (!sensor.has_clock && command.count(name) > 0)
      return Error{std::string(name) + ": " + sensor.name + " sends no time"};
  }
  return std::nullopt;
}

}  // namespace

drivers::ReturnMode return_mode_of(const SimulateArguments& arguments) {
  return value_of(kReturnModes, arguments.return_mode, drivers::ReturnMode::kSingle);
}

GpsReception gps_of(const SimulateArguments& arguments) {
  return value_of(kGpsReceptions, arguments.gps, GpsReception::kLocked);
}

const simulation::SceneInfo& scene_of(const SimulateArguments& arguments) {
  const auto& infos = simulation::scene_infos();
  const auto found = std::find_if(infos.begin(), infos.end(), [&](const simulation::SceneInfo& info) {
    return arguments.scene == info.name;
  });
  return found != infos.end() ? *found : infos.front();
}

std::optional<drivers::VelodyneModel> parse_sensor(const std::string& name) {
  // KITTI's.
  if (name == "hdl64e") return drivers::VelodyneModel::kHdl64eS2;
  return drivers::parse_velodyne_model(name);
}

/// What the chosen scene has no use for.
std::optional<Error> find_useless_in_scene(const CLI::App& command, const SimulateArguments& a) {
  using simulation::SceneKind;
  const simulation::SceneInfo& scene = scene_of(a);
  const auto useless = [&](const char* option, const char* reason) -> std::optional<Error> {
    if (command.count(option) == 0) return std::nullopt;
    return Error{std::string(option) + ": in the scene '" + scene.name + "' " + reason};
  };
  const bool in_town = scene.kind == SceneKind::kTown || scene.kind == SceneKind::kManoeuvres;
  std::optional<Error> error;
  if (scene.kind != SceneKind::kTunnel && command.count("--tunnel-lamps") > 0)
    return Error{"--tunnel-lamps is for --scene tunnel"};
  if (scene.kind != SceneKind::kTown && a.trajectory != "town")
    return Error{"--trajectory: a pose file is driven through the town; leave --scene out"};
  if (!scene.standing_start) error = useless("--moving-start", "the vehicle always begins at speed");
  if (!error && scene.speed_m_s <= 0.0) {
    for (const char* option : {"--speed", "--length", "--moving-start"}) {
      if (!error) error = useless(option, "the vehicle does not move; --duration says for how long");
    }
  }
  const bool empty = scene.kind == SceneKind::kForest || scene.kind == SceneKind::kRamps;
  if (!error && !in_town && empty) error = useless("--moving-cars", "nothing else moves");
  return error;
}

std::optional<Error> find_useless_option(const CLI::App& command, const SimulateArguments& a) {
  const bool town = a.trajectory == "town";
  if (auto error = find_useless_in_scene(command, a)) return error;
  if (!town && command.count("--speed") > 0)
    return Error{"--speed is for the town; a pose file has its own speed"};
  if (a.imu == "none" && !a.imu_faults.empty())
    return Error{"--imu-fault is for an IMU; --imu none records without one"};
  if (const auto faults = simulation::parse_imu_faults(a.imu_faults); !faults) return faults.error();
  for (const char* name : {"--calib", "--pose-interval"}) {
    if (town && command.count(name) > 0)
      return Error{std::string(name) + " is for a pose file given by --trajectory"};
  }
  return find_impossible_option(command, a);
}

void add_simulate_options(CLI::App& command, SimulateArguments& arguments) {
  command.add_option("OUTPUT_DIR", arguments.output, "folder for the recording, made if missing")->required();
  add_drive_options(command, arguments);
  add_lidar_options(command, arguments);
  add_clock_options(command, arguments);
  add_imu_options(command, arguments);
  command.add_option("--seed", arguments.seed, "town, traffic and noise")->capture_default_str();
}

}  // namespace nilio::tools
