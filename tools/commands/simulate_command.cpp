#include "nilio/drivers/imu/mapping.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"
#include "tools/simulate/faults/imu_faults.hpp"
#include "tools/simulate/sensors/hdl64e_stream.hpp"
#include "tools/simulate/simulate.hpp"
#include "tools/simulate/town/town_drive.hpp"

#include <algorithm>
#include <array>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

namespace nilio::tools {

namespace {

using core::Error;
using namespace simulate;

/// The options, and as text those that are names.
struct Arguments {
  simulate::Options options;
  std::string sensor = "vlp16";
  std::string return_mode = "single";
  std::string gps = "locked";
  std::string stream_calibration;
  std::string scene = "town";
  std::string realism = "typical";
  std::vector<std::string> effects;
  std::string imu_grade;
  std::string weather = "clear";
};

// In the order of help texts and messages.
const std::vector<std::pair<std::string, drivers::ReturnMode>> kReturnModes{
    {"single", drivers::ReturnMode::kSingle},
    {"dual", drivers::ReturnMode::kDual},
    {"dual_confidence", drivers::ReturnMode::kDualConfidence}};
const std::vector<std::pair<std::string, GpsReception>> kGpsReceptions{
    {"locked", GpsReception::kLocked}, {"nmea", GpsReception::kNmeaOnly}, {"none", GpsReception::kNone}};

const std::vector<std::pair<std::string, Realism>> kRealisms{
    {"ideal", Realism::kIdeal}, {"typical", Realism::kTypical}, {"poor", Realism::kPoor}};

template <class Value>
std::vector<std::string> names_of(const std::vector<std::pair<std::string, Value>>& values) {
  std::vector<std::string> names;
  names.reserve(values.size());
  for (const auto& [name, value] : values) names.push_back(name);
  return names;
}

/// Value of a name that the parser has accepted.
template <class Value>
Value value_of(const std::vector<std::pair<std::string, Value>>& values, const std::string& wanted) {
  return std::find_if(values.begin(), values.end(), [&](const auto& value) { return value.first == wanted; })
      ->second;
}

std::vector<std::string> scene_names() {
  std::vector<std::string> names;
  for (const SceneInfo& info : scene_infos()) names.emplace_back(info.name);
  return names;
}

std::string describe_scenes() {
  std::string text = "where to drive:";
  for (const SceneInfo& info : scene_infos()) {
    text += std::string("\n") + info.name + ": " + info.summary;
    if (info.speed_m_s > 0.0) text += " (" + std::to_string(static_cast<int>(info.speed_m_s)) + " m/s)";
  }
  return text + "\n";
}

/// Unset for the name of no sensor.
std::optional<drivers::VelodyneModel> parse_sensor(const std::string& name) {
  // The model of KITTI.
  if (name == "hdl64e") return drivers::VelodyneModel::kHdl64eS2;
  return drivers::parse_velodyne_model(name);
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

/// Fills the options of names that the parser has accepted.
void parse_names(Arguments& a) {
  a.options.sensor = *parse_sensor(a.sensor);
  a.options.return_mode = value_of(kReturnModes, a.return_mode);
  a.options.gps = value_of(kGpsReceptions, a.gps);
  if (!a.stream_calibration.empty()) a.options.stream_calibration = a.stream_calibration == "on";
  a.options.realism = value_of(kRealisms, a.realism);
  if (!a.imu_grade.empty()) {
    const auto& grades = imu_grade_names();
    a.options.imu_grade =
        static_cast<ImuGrade>(std::find(grades.begin(), grades.end(), a.imu_grade) - grades.begin());
  }
  const auto& scenes = scene_infos();
  a.options.scene = std::find_if(scenes.begin(), scenes.end(), [&](const SceneInfo& info) {
                      return a.scene == info.name;
                    })->kind;
}

void add_drive_options(CLI::App& command, Arguments& a) {
  command.add_option("--scene", a.scene, describe_scenes())
      ->check(CLI::IsMember(scene_names()))
      ->capture_default_str();
  command.add_flag("--tunnel-lamps", a.options.tunnel_lamps,
                   "lamps and niches in the tunnel; by default it is bare");
  command
      .add_option("--trajectory", a.options.trajectory,
                  "'town', or a KITTI pose file (camera poses, 12 numbers a line) to drive along")
      ->capture_default_str();
  command.add_option("--calib", a.options.calibration,
                     "KITTI calib.txt with Tr for the pose file; default: that of sequences 00-02");
  command
      .add_option("--pose-interval", a.options.pose_interval_s, "seconds from pose to pose in the pose file")
      ->check(number_between(0.001, 10.0))
      ->capture_default_str();
  command.add_option("--length", a.options.extent.length_m, "metres to drive; default: the whole drive")
      ->check(number_between(1.0, 100000.0));
  command.add_option("--duration", a.options.extent.duration_s, "seconds to drive; default: the whole drive")
      ->check(number_between(0.5, 7200.0));
  command
      .add_option("--speed", a.options.speed_m_s,
                  "cruising speed, m/s; default: the scene's own, 10 in the town")
      ->check(number_between(0.5, 40.0));
  command.add_flag("--moving-start", a.options.moving_start,
                   "begin at speed instead of being stationary for 2 s; always so in the tunnel");
}

void add_lidar_options(CLI::App& command, Arguments& a) {
  command.add_option("--sensor", a.sensor, "LiDAR: " + sensor_names())
      ->check(sensor_name())
      ->capture_default_str();
  command
      .add_option(
          "--lidar-extrinsic", a.options.lidar_extrinsic,
          "mounting of the LiDAR on the vehicle: x y z in m, roll pitch yaw in deg; default: 0 0 1.73 "
          "0 0 0")
      ->type_name("X Y Z ROLL PITCH YAW")
      ->check(number_between(-360.0, 360.0));
  command
      .add_option("--mounting-error", a.options.mounting_error,
                  "pose of the LiDAR relative to --lidar-extrinsic, which nilio.yaml does not contain")
      ->type_name("X Y Z ROLL PITCH YAW")
      ->check(number_between(-360.0, 360.0));
  command.add_option("--return-mode", a.return_mode, "returns in each packet")
      ->check(CLI::IsMember(names_of(kReturnModes)))
      ->capture_default_str();
  command.add_option("--rpm", a.options.revolutions_per_minute, "revolutions per minute")
      ->check(number_between(300.0, 1200.0))
      ->capture_default_str();
  command.add_option("--range-noise", a.options.range_noise_m, "standard deviation of a range, m")
      ->check(number_between(0.0, 1.0))
      ->capture_default_str();
  command
      .add_option("--scene-density", a.options.scene_density,
                  "scales the number of buildings, trees, parked cars and posts")
      ->check(number_between(0.0, 3.0))
      ->capture_default_str();
  command
      .add_option("--moving-cars", a.options.moving_cars,
                  "maximum number; default: one per 30 m in the town, elsewhere the scene's own")
      ->check(number_between(0.0, 5000.0));
}

void add_realism_options(CLI::App& command, Arguments& a) {
  command
      .add_option(
          "--realism", a.realism,
          "departures from the ideal: ideal: calibrated sensor with white noise, solid objects; typical: a "
          "healthy unit on a car, as measured; poor: twice the errors")
      ->check(CLI::IsMember(names_of(kRealisms)))
      ->capture_default_str();
  std::string names;
  for (const std::string& name : effect_names()) names += (names.empty() ? "" : ", ") + name;
  command.add_option("--effects", a.effects, "these effects alone, for studies: " + names)
      ->delimiter(',')
      ->type_name("NAME,...");
  command
      .add_option("--weather", a.weather,
                  "clear; wet (ground); rain=MM_PER_H; fog=M or dust=M: visibility in metres")
      ->capture_default_str();
  command
      .add_option("--dirt", a.options.dirt_deg,
                  "sector straight ahead in which dirt on the window lets 2 % of the light through, deg")
      ->check(number_between(0.0, 360.0))
      ->capture_default_str();
}

void add_clock_options(CLI::App& command, Arguments& a) {
  command.add_option("--gps", a.gps, "GPS receiver of the LiDAR: pulse and time, time only, none")
      ->check(CLI::IsMember(names_of(kGpsReceptions)))
      ->capture_default_str();
  command.add_option("--sensor-clock-offset-s", a.options.clock_offset_s, "LiDAR's clock less the host's, s")
      ->check(number_between(-1e6, 1e6))
      ->capture_default_str();
  command
      .add_option("--sensor-clock-drift-ppm", a.options.clock_drift_ppm,
                  "rate error of the LiDAR's clock, parts per million")
      ->check(number_between(-1000.0, 1000.0))
      ->capture_default_str();
  command
      .add_option("--network-jitter-us", a.options.network_jitter_us,
                  "maximum additional delay of a packet, us")
      ->check(number_between(0.0, 20000.0))
      ->capture_default_str();
  command
      .add_option("--stream-calibration", a.stream_calibration,
                  "whether an HDL-64E sends its calibration (rounded to the stream's steps, and written to "
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

void add_imu_options(CLI::App& command, Arguments& a) {
  command.add_option("--imu", a.options.imu, "IMU and its CAN frames")
      ->check(CLI::IsMember(imu_names()))
      ->capture_default_str();
  command.add_option("--imu-rate", a.options.imu_rate_hz, "samples per second")
      ->check(number_between(10.0, 1000.0))
      ->capture_default_str();
  command
      .add_option("--imu-extrinsic", a.options.imu_extrinsic,
                  "mounting of the IMU as --lidar-extrinsic; default: -0.81 0.32 0.93 0.5 -0.3 0.8")
      ->type_name("X Y Z ROLL PITCH YAW")
      ->check(number_between(-360.0, 360.0));
  command
      .add_option(
          "--imu-grade", a.imu_grade,
          "errors of a class of IMU, from data sheets, instead of the constants below; default: industrial "
          "if typical, automotive if poor")
      ->check(CLI::IsMember(imu_grade_names()));
  const auto add_error = [&](const char* name, double& value, const char* help) {
    command.add_option(name, value, help)->check(number_between(0.0, 1e6))->capture_default_str();
  };
  add_error("--gyro-noise", a.options.gyro_noise_deg_s, "deg/s/sqrt(Hz)");
  add_error("--gyro-bias", a.options.gyro_bias_deg_s, "constant bias of each axis, deg/s");
  add_error("--gyro-drift", a.options.gyro_drift_deg_h, "in-run bias, deg/h");
  add_error("--gyro-scale", a.options.gyro_scale_percent, "error of each axis's scale, %");
  add_error("--accel-noise", a.options.accel_noise_ug, "micro-g/sqrt(Hz)");
  add_error("--accel-bias", a.options.accel_bias_m_s2, "constant bias of each axis, m/s^2");
  add_error("--accel-drift", a.options.accel_drift_ug, "in-run bias, micro-g");
  add_error("--accel-scale", a.options.accel_scale_percent, "error of each axis's scale, %");
  command
      .add_option("--imu-fault", a.options.imu_faults,
                  "fault of the IMU; may be given several times:\n" + describe_imu_faults())
      ->allow_extra_args(false)
      ->type_name("NAME[=VALUE]");
}

constexpr std::array kImuConstants{"--gyro-noise",  "--gyro-bias",  "--gyro-drift",  "--gyro-scale",
                                   "--accel-noise", "--accel-bias", "--accel-drift", "--accel-scale"};

/// Sets the options that depend on one another; the error names the option.
std::optional<Error> set_realism(const CLI::App& command, Arguments& a) {
  if (!a.effects.empty()) {
    const auto effects = parse_effects(a.effects);
    if (!effects) return effects.error();
    a.options.effects = *effects;
  }
  const auto weather = parse_weather(a.weather);
  if (!weather) return weather.error();
  a.options.weather = *weather;
  for (const char* name : kImuConstants) {
    if (command.count(name) == 0) continue;
    if (a.options.imu_grade) return Error{std::string(name) + ": --imu-grade sets it - give one of both"};
    a.options.imu_constants = true;
  }
  if (a.options.imu == "none" && a.options.imu_grade)
    return Error{"--imu-grade is for an IMU; --imu none records without one"};
  if (effects_of(a.options).has(Effect::kNoise) && command.count("--range-noise") > 0)
    return Error{
        "--range-noise: the noise follows from --realism - give --realism ideal, or --effects without noise"};
  return std::nullopt;
}

/// Error for an option that the chosen LiDAR does not support.
std::optional<Error> find_impossible_option(const CLI::App& command, const Arguments& a) {
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(a.options.sensor);
  if (sensor.layout(a.options.return_mode) == nullptr) {
    std::string modes;
    for (const auto& [name, mode] : kReturnModes) {
      if (sensor.layout(mode) != nullptr) modes += (modes.empty() ? "" : ", ") + name;
    }
    return Error{"--return-mode: " + sensor.name + " has only " + modes};
  }
  if (!a.stream_calibration.empty() && !has_status_stream(a.options.sensor))
    return Error{"--stream-calibration: " + sensor.name +
                 " sends no calibration; an HDL-64E-S2 or later does"};
  for (const char* name : {"--gps", "--sensor-clock-offset-s", "--sensor-clock-drift-ppm"}) {
    if (!sensor.has_clock && command.count(name) > 0)
      return Error{std::string(name) + ": " + sensor.name + " sends no time"};
  }
  return std::nullopt;
}

/// Error for an option that the chosen scene does not use.
std::optional<Error> find_unused_in_scene(const CLI::App& command, const Arguments& a) {
  const SceneInfo& scene = info_of(a.options.scene);
  const auto unused = [&](const char* option, const char* reason) -> std::optional<Error> {
    if (command.count(option) == 0) return std::nullopt;
    return Error{std::string(option) + ": in the scene '" + scene.name + "' " + reason};
  };
  const bool in_town = is_town(scene.kind);
  std::optional<Error> error;
  if (scene.kind != SceneKind::kTunnel && command.count("--tunnel-lamps") > 0)
    return Error{"--tunnel-lamps is for --scene tunnel"};
  for (const char* option : {"--visit", "--way-back"}) {
    if (!in_town && command.count(option) > 0) return Error{std::string(option) + " is for the town"};
  }
  if (scene.kind != SceneKind::kTown && a.options.trajectory != "town")
    return Error{"--trajectory: a pose file is driven through the town - leave --scene out"};
  if (!town_script(scene.kind, 1.0).empty()) error = unused("--moving-start", "the drive begins at a halt");
  if (!error && !scene.may_start_stationary)
    error = unused("--moving-start", "the vehicle always begins at speed");
  if (!error && scene.speed_m_s <= 0.0) {
    for (const char* option : {"--speed", "--length", "--moving-start"}) {
      if (!error) error = unused(option, "the vehicle does not move - set --duration");
    }
  }
  const bool traffic = scene.kind == SceneKind::kHighway || scene.kind == SceneKind::kQueue ||
                       scene.kind == SceneKind::kTunnel || scene.kind == SceneKind::kStandstill;
  if (!error && !in_town && !traffic) error = unused("--moving-cars", "there is no traffic");
  return error;
}

/// Error for an option that the chosen scene, trajectory or LiDAR does not use.
std::optional<Error> find_unused_option(const CLI::App& command, const Arguments& a) {
  const bool town = a.options.trajectory == "town";
  if (auto error = find_unused_in_scene(command, a)) return error;
  if (!town && command.count("--speed") > 0)
    return Error{"--speed is for the town; a pose file has its own speed"};
  if (a.options.imu == "none" && !a.options.imu_faults.empty())
    return Error{"--imu-fault is for an IMU; --imu none records without one"};
  if (const auto faults = parse_imu_faults(a.options.imu_faults); !faults) return faults.error();
  for (const char* name : {"--calib", "--pose-interval"}) {
    if (town && command.count(name) > 0)
      return Error{std::string(name) + " is for a pose file given by --trajectory"};
  }
  return find_impossible_option(command, a);
}

int run_simulate(const CLI::App& command, Arguments& arguments) {
  parse_names(arguments);
  const auto fail = [](const Error& error, ExitStatus status) {
    std::cerr << "nilio simulate: " << error.message << '\n';
    return status;
  };
  if (const auto error = set_realism(command, arguments)) return fail(*error, kUsageError);
  if (const auto error = find_unused_option(command, arguments)) return fail(*error, kUsageError);
  const core::Result<bool> written = simulate::write_recording(arguments.options);
  return written ? kDone : fail(written.error(), kFailed);
}

}  // namespace

void add_simulate_command(CLI::App& app, int& status) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand("simulate", "record a simulated drive through a synthetic scene");
  command->footer(
      "Writes lidar.pcap, imu.candump.log, truth.tum (base_link, on the ground, every 5 ms), "
      "nilio.yaml, and calibration.yaml if the LiDAR sends its calibration, to OUTPUT_DIR; files there are "
      "replaced. The same options give the same bytes.\n\n"
      "Examples:\n"
      "  nilio simulate OUT                                        a tour of 640 m through the town\n"
      "  nilio simulate OUT --scene highway --sensor hdl64e        among trucks at 30 m/s\n"
      "  nilio simulate OUT --scene tunnel --imu none              300 m of bare tunnel\n"
      "  nilio simulate OUT --scene ramps                          up a car park\n"
      "  nilio simulate OUT --scene forest --speed 4               slowly over humps\n"
      "  nilio simulate OUT --scene standstill --duration 2700     45 minutes beside a road\n"
      "  nilio simulate OUT --scene manoeuvres --duration 90       1 g, 90 deg/s");
  command->add_option("OUTPUT_DIR", arguments->options.output, "folder for the recording, created if missing")
      ->required();
  add_drive_options(*command, *arguments);
  add_lidar_options(*command, *arguments);
  add_realism_options(*command, *arguments);
  add_clock_options(*command, *arguments);
  add_imu_options(*command, *arguments);
  command->add_option("--seed", arguments->options.seed, "seed of scene, traffic and noise")
      ->capture_default_str();
  command->add_option(
      "--visit", arguments->options.visit,
      "the town of --seed at another time, by its number: other traffic, parked cars and noise, "
      "20 % of the objects differ between two visits");
  command->add_flag("--way-back", arguments->options.way_back,
                    "in the town: drive the route backwards, in the oncoming lane");
  command->callback([arguments, command, &status] { status = run_simulate(*command, *arguments); });
}

}  // namespace nilio::tools
