#include "nilio/core/units.hpp"
#include "nilio/drivers/velodyne/calibration/calibration.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tools/common/commands.hpp"
#include "tools/simulate/faults/imu_faults.hpp"
#include "tools/simulate/geometry/ray_scene.hpp"
#include "tools/simulate/options.hpp"
#include "tools/simulate/scene.hpp"
#include "tools/simulate/sensors/hdl64e_stream.hpp"
#include "tools/simulate/sensors/imu_model.hpp"
#include "tools/simulate/sensors/lidar_model.hpp"
#include "tools/simulate/sensors/position_model.hpp"
#include "tools/simulate/sensors/recording.hpp"

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <utility>

#include <CLI/CLI.hpp>

namespace nilio::tools {

namespace fs = std::filesystem;

namespace {

using core::Error;
using core::Result;
using namespace simulation;

/// 2026-01-01T12:00:00Z: recordings of the same seed are the same, stamps included.
constexpr core::Time kStart{1'767'268'800'000'000'000};
const Mounting kLidarMounting{{0.0, 0.0, 1.73}, {0.0, 0.0, 0.0}};
const Mounting kImuMounting{{-0.81, 0.32, 0.93}, {0.5, -0.3, 0.8}};

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
  config.gyroscope = {
      arguments.gyro_noise_deg_s * kRadiansPerDegree, arguments.gyro_bias_deg_s * kRadiansPerDegree,
      arguments.gyro_drift_deg_h * kRadiansPerDegree / 3600.0, 0.01 * arguments.gyro_scale_percent};
  config.accelerometer = {arguments.accel_noise_ug * micro_g, arguments.accel_bias_m_s2,
                          arguments.accel_drift_ug * micro_g, 0.01 * arguments.accel_scale_percent};
  return config;
}

void print_drive(double length_m, const VehicleTrajectory& trajectory) {
  std::printf("drive: %.1f m in %.1f s\n", length_m, trajectory.duration_s());
}

void print_scene(const Scene& scene) {
  std::printf("scene: %s, %zu moving cars; %.2f million triangles\n", scene.contents.c_str(),
              scene.cars.size(), static_cast<double>(scene.mesh.triangles.size()) * 1e-6);
  std::fflush(stdout);
}

void print_lidar(const LidarRecordingSummary& lidar, const fs::path& path) {
  std::printf(
      "%s: %llu packets, %llu position packets, %.2f million firings, %.1f %% returned, "
      "%.2f million firings/s\n",
      path.c_str(), static_cast<unsigned long long>(lidar.packets),
      static_cast<unsigned long long>(lidar.position_packets), static_cast<double>(lidar.firings) * 1e-6,
      100.0 * static_cast<double>(lidar.returns) / static_cast<double>(lidar.firings),
      static_cast<double>(lidar.firings) * 1e-6 / lidar.elapsed_s);
}

/// The sensor, and for an HDL-64E what it says of itself.
struct LidarSetup {
  drivers::VelodyneSensor sensor;
  std::optional<Hdl64eStream> stream;
};

/// An HDL-64E that sends its calibration has lasers rounded to what can be sent. KITTI's S2 keeps its own:
/// they are known to less than a millimetre.
Result<LidarSetup> make_lidar(const SimulateArguments& arguments) {
  LidarSetup setup;
  setup.sensor =
      drivers::make_velodyne_sensor(parse_sensor(arguments.sensor).value_or(drivers::VelodyneModel::kVlp16));
  const drivers::VelodyneModel model = setup.sensor.model;
  if (!has_status_stream(model)) return setup;
  const bool by_itself = arguments.stream_calibration.empty() && model != drivers::VelodyneModel::kHdl64eS2;
  if (!by_itself && arguments.stream_calibration != "on") {
    setup.stream = Hdl64eStream(gps_of(arguments));
    return setup;
  }
  auto stream = Hdl64eStream::with_calibration(setup.sensor, return_mode_of(arguments),
                                               arguments.revolutions_per_minute, gps_of(arguments));
  if (!stream) return stream.error();
  auto rounded = drivers::with_stream_calibration(std::move(setup.sensor), *stream->calibration());
  if (!rounded) return rounded.error();
  return LidarSetup{std::move(rounded).value(), std::move(stream).value()};
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
                               const LidarSetup& lidar, const fs::path& folder) {
  const bool with_imu = arguments.imu != "none";
  const fs::path imu_path = folder / "imu.candump.log";
  const fs::path calibration_path = folder / "calibration.yaml";
  std::error_code ignored;
  fs::remove(imu_path, ignored);
  fs::remove(calibration_path, ignored);
  if (with_imu) {
    const auto imu = write_inertial_data(arguments, trajectory, imu_path);
    if (!imu) return imu.error();
  }
  const auto truth = write_truth(trajectory, kStart, (folder / "truth.tum").string());
  if (!truth) return truth.error();
  std::printf("%s: %llu poses\n", (folder / "truth.tum").c_str(), static_cast<unsigned long long>(*truth));
  RecordedSensors sensors;
  sensors.lidar_model = drivers::velodyne_model_name(lidar.sensor.model);
  sensors.lidar = kLidarMounting;
  sensors.imu_preset = with_imu ? arguments.imu : std::string();
  sensors.imu = kImuMounting;
  if (lidar.stream && lidar.stream->calibration()) {
    const auto written = drivers::write_calibration_yaml(lidar.sensor, calibration_path.string());
    if (!written) return written.error();
    sensors.calibration_file = calibration_path.filename().string();
  }
  return write_configuration(sensors, (folder / "nilio.yaml").string());
}

Result<LidarRecordingSummary> write_lidar(const SimulateArguments& arguments, const LidarSetup& setup,
                                          const VehicleTrajectory& trajectory, const RayScene& scene,
                                          const fs::path& path) {
  LidarModelConfig config;
  config.seed = arguments.seed;
  config.start = kStart;
  config.T_base_lidar = kLidarMounting.T_base_sensor();
  config.revolutions_per_minute = arguments.revolutions_per_minute;
  config.range_noise_m = arguments.range_noise_m;
  config.return_mode = return_mode_of(arguments);
  config.gps = gps_of(arguments);
  config.clock_offset = core::Duration::from_seconds(arguments.clock_offset_s);
  config.clock_drift_ppm = arguments.clock_drift_ppm;
  config.network_jitter = core::Duration::from_seconds(arguments.network_jitter_us * 1e-6);
  config.stream = setup.stream;
  const LidarModel model(setup.sensor, config, trajectory, scene);
  const PositionModel positions(setup.sensor.model, gps_of(arguments), config.T_base_lidar, model.timing(),
                                trajectory);
  return write_lidar_recording(model, sends_position_packets(setup.sensor.model) ? &positions : nullptr,
                               path.string());
}

Result<bool> simulate(const SimulateArguments& arguments) {
  const Result<LidarSetup> setup = make_lidar(arguments);
  if (!setup) return setup.error();
  const Result<fs::path> folder = prepare_folder(arguments.output);
  if (!folder) return folder.error();
  Result<Scene> made = make_scene(arguments, kLidarMounting.T_base_sensor());
  if (!made) return made.error();
  const VehicleTrajectory trajectory(made->poses, kControlIntervalS);
  print_drive(path_length(made->poses), trajectory);
  print_scene(*made);
  const Result<RayScene> scene = RayScene::create(made->mesh, std::move(made->cars));
  if (!scene) return scene.error();

  // The small files first: they show at once whether the folder can be written.
  const Result<bool> small_files = write_small_files(arguments, trajectory, *setup, *folder);
  if (!small_files) return small_files.error();
  const Result<LidarRecordingSummary> lidar =
      write_lidar(arguments, *setup, trajectory, *scene, *folder / "lidar.pcap");
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

}  // namespace

void add_simulate_command(CLI::App& app, int& status) {
  auto arguments = std::make_shared<SimulateArguments>();
  CLI::App* command =
      app.add_subcommand("simulate", "drive a simulated vehicle through a made-up scene and record it");
  command->footer(
      "Writes lidar.pcap, imu.candump.log, truth.tum (base_link, on the ground under the LiDAR, every 5 "
      "ms),\n"
      "nilio.yaml, and calibration.yaml if the LiDAR sends its calibration, to OUTPUT_DIR; files there are\n"
      "replaced. The same options give the same bytes.\n\n"
      "Examples:\n"
      "  nilio simulate OUT                                        a tour of 640 m through the town\n"
      "  nilio simulate OUT --scene highway --sensor hdl64e        among trucks at 30 m/s\n"
      "  nilio simulate OUT --scene tunnel --imu none              300 m without anything to see\n"
      "  nilio simulate OUT --scene ramps                          up a car park\n"
      "  nilio simulate OUT --scene forest --speed 4               slowly over humps\n"
      "  nilio simulate OUT --scene standstill --duration 2700     45 minutes beside a road\n"
      "  nilio simulate OUT --scene manoeuvres --duration 90       1 g, 90 deg/s");
  add_simulate_options(*command, *arguments);
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
