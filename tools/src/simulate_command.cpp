#include "nilio/drivers/velodyne_model.hpp"

#include "commands.hpp"
#include "number_between.hpp"
#include "simulation/imu_faults.hpp"
#include "simulation/imu_model.hpp"
#include "simulation/lidar_model.hpp"
#include "simulation/ray_scene.hpp"
#include "simulation/recorded_drive.hpp"
#include "simulation/recording.hpp"
#include "simulation/town.hpp"
#include "simulation/town_drive.hpp"
#include "simulation/traffic.hpp"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace nilio::tools {

namespace fs = std::filesystem;

namespace {

using core::Error;
using core::Result;
using core::SE3;
using namespace simulation;

constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;
/// 2026-01-01T12:00:00Z: recordings of the same seed are the same, stamps included.
constexpr core::Time kStart{1'767'268'800'000'000'000};
const Mounting kLidarMounting{{0.0, 0.0, 1.73}, {0.0, 0.0, 0.0}};
const Mounting kImuMounting{{-0.81, 0.32, 0.93}, {0.5, -0.3, 0.8}};
constexpr double kMetresPerMovingCar = 30.0;

/// Options in the units that data sheets use.
struct SimulateArguments {
  std::string output;
  std::string sensor = "vlp16";
  std::string trajectory = "town";
  std::string calibration;
  double pose_interval_s = 0.1037;
  DriveExtent extent;
  double speed_m_s = 10.0;
  bool moving_start = false;
  double revolutions_per_minute = 600.0;
  double range_noise_m = 0.02;
  std::string imu = "xsens_mti";
  double imu_rate_hz = 200.0;
  double gyro_noise_deg_s = 0.007;
  double gyro_bias_deg_s = 0.1;
  double gyro_drift_deg_h = 10.0;
  double accel_noise_ug = 120.0;
  double accel_bias_m_s2 = 0.02;
  double accel_drift_ug = 30.0;
  std::vector<std::string> imu_faults;
  double scene_density = 1.0;
  std::optional<unsigned> moving_cars;
  std::uint64_t seed = 1;
};

Result<std::vector<SE3>> make_drive(const SimulateArguments& arguments) {
  if (arguments.trajectory == "town") {
    return make_town_drive({arguments.seed, arguments.speed_m_s, arguments.moving_start, arguments.extent});
  }
  return make_recorded_drive({arguments.trajectory, arguments.calibration, arguments.pose_interval_s,
                              arguments.moving_start, kLidarMounting.T_base_sensor(), arguments.extent});
}

Result<fs::path> prepare_folder(const std::string& output) {
  std::error_code error;
  fs::create_directories(output, error);
  if (error)
    return Error{output + ": cannot be made (" + error.message() +
                 "); choose a folder that you may write to"};
  return fs::path(output);
}

ImuModelConfig imu_config(const SimulateArguments& arguments) {
  constexpr double micro_g = 1e-6 * 9.80665;
  ImuModelConfig config;
  config.seed = arguments.seed;
  config.start = kStart;
  config.T_base_imu = kImuMounting.T_base_sensor();
  config.rate_hz = arguments.imu_rate_hz;
  config.gyroscope = {arguments.gyro_noise_deg_s * kRadiansPerDegree,
                      arguments.gyro_bias_deg_s * kRadiansPerDegree,
                      arguments.gyro_drift_deg_h * kRadiansPerDegree / 3600.0};
  config.accelerometer = {arguments.accel_noise_ug * micro_g, arguments.accel_bias_m_s2,
                          arguments.accel_drift_ug * micro_g};
  return config;
}

void print_drive(double length_m, const VehicleTrajectory& trajectory) {
  std::printf("drive: %.1f m in %.1f s\n", length_m, trajectory.duration_s());
}

void print_scene(const Town& town, std::size_t moving_cars) {
  const TownSummary& s = town.summary;
  std::printf(
      "scene: %zu buildings, %zu trees, %zu bushes, %zu parked cars, %zu lamps and signs, %zu garden walls, "
      "%zu side streets, %zu moving cars; %.2f million triangles\n",
      s.buildings, s.trees, s.bushes, s.parked_cars, s.posts, s.walls, town.layout.side_streets().size(),
      moving_cars, static_cast<double>(town.mesh.triangles.size()) * 1e-6);
  std::fflush(stdout);
}

/// Recorded heights can be wrong by more than the closing of loops repairs.
void warn_off_ground(const Town& town) {
  constexpr double tolerated_m = 0.5;
  double worst_m = 0.0;
  double time_s = 0.0;
  for (const StreetSample& sample : town.layout.samples()) {
    const double gap_m = std::abs(town.ground.height(sample.position) - sample.z);
    if (!sample.driven || gap_m <= worst_m) continue;
    worst_m = gap_m;
    time_s = sample.time_s;
  }
  if (worst_m < tolerated_m) return;
  std::fprintf(
      stderr,
      "nilio simulate: warning: %.1f s into the drive the vehicle is %.1f m off the ground: the pose file's "
      "heights are not those of one road; cut those lines from it\n",
      time_s, worst_m);
}

void print_lidar(const LidarRecordingSummary& lidar, const fs::path& path) {
  std::printf("%s: %llu packets, %.2f million rays, %.1f %% returned, %.2f million rays/s\n", path.c_str(),
              static_cast<unsigned long long>(lidar.packets), static_cast<double>(lidar.firings) * 1e-6,
              100.0 * static_cast<double>(lidar.returns) / static_cast<double>(lidar.firings),
              static_cast<double>(lidar.firings) * 1e-6 / lidar.elapsed_s);
}

Result<bool> write_inertial_data(const SimulateArguments& arguments, const VehicleTrajectory& trajectory,
                                 const fs::path& path) {
  const Result<drivers::ImuPreset> preset = drivers::imu_preset(arguments.imu);
  if (!preset) return preset.error();
  const Result<ImuFaultConfig> faults = parse_imu_faults(arguments.imu_faults);
  if (!faults) return faults.error();
  const auto samples = write_imu_recording(
      ImuModel(imu_config(arguments), trajectory),
      ImuFaults(*faults, kStart, trajectory.duration_s(), arguments.seed), *preset, path.string());
  if (!samples) return samples.error();
  std::printf("%s: %llu samples\n", path.c_str(), static_cast<unsigned long long>(*samples));
  return true;
}

/// `arguments.imu` "none" writes no inertial data, and removes what an earlier run left in the folder.
Result<bool> write_small_files(const SimulateArguments& arguments, const VehicleTrajectory& trajectory,
                               const drivers::VelodyneSensor& sensor, const fs::path& folder) {
  const bool with_imu = arguments.imu != "none";
  const fs::path imu_path = folder / "imu.candump.log";
  std::error_code ignored;
  fs::remove(imu_path, ignored);
  if (with_imu) {
    const auto imu = write_inertial_data(arguments, trajectory, imu_path);
    if (!imu) return imu.error();
  }
  const auto truth = write_truth(trajectory, kStart, (folder / "truth.tum").string());
  if (!truth) return truth.error();
  std::printf("%s: %llu poses\n", (folder / "truth.tum").c_str(), static_cast<unsigned long long>(*truth));
  return write_configuration(drivers::velodyne_model_name(sensor.model), kLidarMounting,
                             with_imu ? arguments.imu : std::string(), kImuMounting,
                             (folder / "nilio.yaml").string());
}

Result<bool> simulate(const SimulateArguments& arguments) {
  const Result<fs::path> folder = prepare_folder(arguments.output);
  if (!folder) return folder.error();
  const Result<std::vector<SE3>> poses = make_drive(arguments);
  if (!poses) return poses.error();
  const VehicleTrajectory trajectory(*poses, kControlIntervalS);
  const double length_m = path_length(*poses);
  print_drive(length_m, trajectory);

  const Result<Town> town = build_town(trajectory, {arguments.seed, arguments.scene_density});
  if (!town) return town.error();
  warn_off_ground(*town);
  const std::size_t wanted_cars =
      arguments.moving_cars.value_or(static_cast<unsigned>(length_m / kMetresPerMovingCar));
  std::vector<MovingCar> cars =
      make_traffic(trajectory, town->layout, town->ground, wanted_cars, arguments.seed);
  print_scene(*town, cars.size());
  const Result<RayScene> scene = RayScene::create(town->mesh, std::move(cars));
  if (!scene) return scene.error();

  const auto kind =
      arguments.sensor == "vlp16" ? drivers::VelodyneModel::kVlp16 : drivers::VelodyneModel::kHdl64eS2;
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(kind);
  const LidarModel model(sensor,
                         {arguments.seed, kStart, kLidarMounting.T_base_sensor(),
                          arguments.revolutions_per_minute, arguments.range_noise_m},
                         trajectory, *scene);
  // The small files first: they show at once whether the folder can be written.
  const Result<bool> small_files = write_small_files(arguments, trajectory, sensor, *folder);
  if (!small_files) return small_files.error();
  const Result<LidarRecordingSummary> lidar = write_lidar_recording(model, (*folder / "lidar.pcap").string());
  if (!lidar) return lidar.error();
  print_lidar(*lidar, *folder / "lidar.pcap");
  return true;
}

int run_simulate(const SimulateArguments& arguments) {
  const Result<bool> done = simulate(arguments);
  if (done) return 0;
  std::cerr << "nilio simulate: " << done.error().message << '\n';
  return 1;
}

void add_drive_options(CLI::App& command, SimulateArguments& a) {
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
  command.add_option("--speed", a.speed_m_s, "cruising speed in the town, m/s")
      ->check(number_between(0.5, 40.0))
      ->capture_default_str();
  command.add_flag("--moving-start", a.moving_start, "begin at speed instead of standing for 2 s");
}

void add_lidar_options(CLI::App& command, SimulateArguments& a) {
  command.add_option("--sensor", a.sensor, "LiDAR")
      ->check(CLI::IsMember({"vlp16", "hdl64e"}))
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
  command.add_option("--moving-cars", a.moving_cars, "how many; default: one per 30 m")
      ->check(number_between(0.0, 5000.0));
}

void add_imu_options(CLI::App& command, SimulateArguments& a) {
  command.add_option("--imu", a.imu, "IMU and its CAN frames")
      ->check(CLI::IsMember({"xsens_mti", "oxts_rt3003", "none"}))
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
  add_error("--accel-noise", a.accel_noise_ug, "micro-g/sqrt(Hz)");
  add_error("--accel-bias", a.accel_bias_m_s2, "constant bias of each axis, m/s^2");
  add_error("--accel-drift", a.accel_drift_ug, "in-run bias, micro-g");
  command
      .add_option("--imu-fault", a.imu_faults,
                  "what is wrong with the IMU; may be given several times:\n" + describe_imu_faults())
      ->allow_extra_args(false)
      ->type_name("NAME[=VALUE]");
}

/// An option that the chosen trajectory does not use is a mistake, not something to pass over.
std::optional<Error> find_useless_option(const CLI::App& command, const SimulateArguments& a) {
  const bool town = a.trajectory == "town";
  if (!town && command.count("--speed") > 0)
    return Error{"--speed is for the town; a pose file has its own speed"};
  if (a.imu == "none" && !a.imu_faults.empty())
    return Error{"--imu-fault is for an IMU; --imu none records without one"};
  if (const auto faults = parse_imu_faults(a.imu_faults); !faults) return faults.error();
  for (const char* name : {"--calib", "--pose-interval"}) {
    if (town && command.count(name) > 0)
      return Error{std::string(name) + " is for a pose file given by --trajectory"};
  }
  return std::nullopt;
}

}  // namespace

void add_simulate_command(CLI::App& app, int& status) {
  auto arguments = std::make_shared<SimulateArguments>();
  CLI::App* command =
      app.add_subcommand("simulate", "drive a simulated vehicle through a made-up town and record it");
  command->footer(
      "Writes lidar.pcap, imu.candump.log, truth.tum (base_link, on the ground under the LiDAR, every 5 ms) "
      "and\n"
      "nilio.yaml to OUTPUT_DIR; files there are replaced. The same options give the same bytes.");
  command->add_option("OUTPUT_DIR", arguments->output, "folder for the recording, made if missing")
      ->required();
  add_drive_options(*command, *arguments);
  add_lidar_options(*command, *arguments);
  add_imu_options(*command, *arguments);
  command->add_option("--seed", arguments->seed, "town, traffic and noise")->capture_default_str();
  command->callback([arguments, command, &status] {
    if (const std::optional<Error> useless = find_useless_option(*command, *arguments)) {
      std::cerr << "nilio simulate: " << useless->message << '\n';
      status = 1;
      return;
    }
    status = run_simulate(*arguments);
  });
}

}  // namespace nilio::tools
