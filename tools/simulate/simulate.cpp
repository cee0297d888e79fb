#include "tools/simulate/simulate.hpp"

#include "nilio/core/units.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tools/common/files.hpp"
#include "tools/simulate/faults/imu_faults.hpp"
#include "tools/simulate/geometry/ray_scene.hpp"
#include "tools/simulate/scenes/traffic.hpp"
#include "tools/simulate/sensors/hdl64e_stream.hpp"
#include "tools/simulate/sensors/imu_model.hpp"
#include "tools/simulate/sensors/lidar_model.hpp"
#include "tools/simulate/sensors/position_model.hpp"
#include "tools/simulate/sensors/recording.hpp"
#include "tools/simulate/town/town.hpp"
#include "tools/simulate/town/town_drive.hpp"
#include "tools/simulate/vehicle/recorded_drive.hpp"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <numbers>
#include <system_error>
#include <utility>

namespace nilio::tools::simulate {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;
using core::SE3;

/// 2026-01-01T12:00:00Z. Fixed, so that recordings of the same seed are equal, stamps included.
constexpr core::Time kStart{1'767'268'800'000'000'000};
/// Of the LiDAR that recorded a pose file: KITTI's.
const Mounting kRecordedLidarMounting{{0.0, 0.0, 1.73}, {0.0, 0.0, 0.0}};

constexpr double kMetresPerMovingCar = 30.0;

Mounting mounting_of(const std::array<double, 6>& e) { return {{e[0], e[1], e[2]}, {e[3], e[4], e[5]}}; }

/// As configured, and as it is.
Mounting lidar_mounting(const Options& options) { return mounting_of(options.lidar_extrinsic); }
SE3 T_base_actual_lidar(const Options& options) {
  const SE3 T_base_lidar = lidar_mounting(options).T_base_sensor();
  const bool exact = options.mounting_error == std::array<double, 6>{};
  return exact ? T_base_lidar : T_base_lidar * mounting_of(options.mounting_error).T_base_sensor();
}

SceneConfig scene_config(const Options& options) {
  SceneConfig config;
  config.seed = options.seed;
  config.extent = options.extent;
  config.speed_m_s = options.speed_m_s.value_or(info_of(options.scene).speed_m_s);
  config.moving_start = options.moving_start;
  config.density = options.scene_density;
  config.moving_cars = options.moving_cars;
  config.tunnel_lamps = options.tunnel_lamps;
  config.porous_plants = effects_of(options).has(Effect::kVegetation);
  config.clutter = effects_of(options).has(Effect::kClutter);
  config.steady_body = effects_of(options).has(Effect::kVehicle);
  return config;
}

Result<std::vector<SE3>> make_town_poses(const Options& options, const SE3& T_base_lidar) {
  if (options.trajectory == "town") {
    const SceneInfo& scene = info_of(options.scene);
    if (!town_script(options.scene, 1.0).empty())
      return make_scripted_town_drive(options.scene, scene_config(options));
    return make_town_drive({options.seed, options.speed_m_s.value_or(scene.speed_m_s), options.moving_start,
                            options.extent, scene.kind == SceneKind::kManoeuvres,
                            effects_of(options).has(Effect::kVehicle)});
  }
  return make_recorded_drive({options.trajectory, options.calibration, options.pose_interval_s,
                              options.moving_start, T_base_lidar, options.extent});
}

/// Warns of a path above the ground: recorded heights can be wrong by more than the height closure corrects.
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

std::string describe(const Town& town) {
  const TownSummary& s = town.summary;
  return counted(s.buildings, "buildings, ") + counted(s.trees, "trees, ") + counted(s.bushes, "bushes, ") +
         counted(s.parked_cars, "parked cars, ") + counted(s.posts, "lamps and signs, ") +
         counted(s.walls, "garden walls, ") + counted(town.layout.side_streets().size(), "side streets");
}

/// The drive turned round, in the oncoming lane.
std::vector<SE3> way_back(const std::vector<SE3>& poses) {
  const SE3 T_base_turned{core::so3_exp({0.0, 0.0, std::numbers::pi}), {0.0, kOncomingLaneM, 0.0}};
  std::vector<SE3> result;
  for (auto pose = poses.rbegin(); pose != poses.rend(); ++pose) result.push_back(*pose * T_base_turned);
  return result;
}

Result<Scene> make_town_scene(const Options& options, const SE3& T_base_lidar) {
  Result<std::vector<SE3>> poses = make_town_poses(options, T_base_lidar);
  if (!poses) return poses.error();
  const VehicleTrajectory trajectory(*poses, kControlIntervalS);
  Result<Town> town = build_town(
      trajectory, {options.seed, options.scene_density, effects_of(options).has(Effect::kVegetation),
                   effects_of(options).has(Effect::kClutter), options.visit});
  if (!town) return town.error();
  warn_off_ground(*town);
  if (options.way_back) *poses = way_back(*poses);
  const VehicleTrajectory drive(*poses, kControlIntervalS);
  const std::size_t wanted_cars =
      options.moving_cars.value_or(static_cast<unsigned>(path_length(*poses) / kMetresPerMovingCar));
  Scene scene;
  scene.cars = make_traffic(drive, town->layout, town->ground, wanted_cars, visit_seed(options));
  scene.road = town_road(path_length(*poses), options.seed);
  scene.poses = std::move(*poses);
  scene.contents = describe(*town);
  scene.mesh = std::move(town->mesh);
  return scene;
}

Result<Scene> make_scene(const Options& options, const SE3& T_base_lidar) {
  if (is_town(options.scene)) return make_town_scene(options, T_base_lidar);
  return build_scene(options.scene, scene_config(options));
}

SurfaceDetail surface_detail(const Effects& effects) {
  constexpr float kGrassM = 0.08F;
  return {effects.has(Effect::kVegetation) ? kGrassM : 0.0F, effects.has(Effect::kGround)};
}

Result<fs::path> prepare_folder(const std::string& output) {
  std::error_code error;
  fs::create_directories(output, error);
  if (error)
    return Error{output + ": could not be created (" + error.message() + ") - choose a writable folder"};
  return fs::path(output);
}

ImuModelConfig imu_config(const Options& options) {
  constexpr double micro_g = 1e-6 * 9.80665;
  ImuModelConfig config;
  config.seed = visit_seed(options);
  config.start = kStart;
  config.T_base_imu = mounting_of(options.imu_extrinsic).T_base_sensor();
  config.rate_hz = options.imu_rate_hz;
  config.gyroscope = {
      options.gyro_noise_deg_s * kRadiansPerDegree, options.gyro_bias_deg_s * kRadiansPerDegree,
      options.gyro_drift_deg_h * kRadiansPerDegree / 3600.0, 0.01 * options.gyro_scale_percent};
  config.accelerometer = {options.accel_noise_ug * micro_g, options.accel_bias_m_s2,
                          options.accel_drift_ug * micro_g, 0.01 * options.accel_scale_percent};
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

/// The sensor, and for an HDL-64E its status stream.
struct LidarSetup {
  drivers::VelodyneSensor sensor;
  std::optional<Hdl64eStream> stream;
};

/// An HDL-64E that sends its calibration has lasers rounded to the stream's steps. KITTI's S2 keeps its own,
/// which are exact to less than a millimetre.
Result<LidarSetup> make_lidar(const Options& options) {
  LidarSetup setup;
  setup.sensor = drivers::make_velodyne_sensor(options.sensor);
  if (!has_status_stream(options.sensor)) return setup;
  if (!options.stream_calibration.value_or(options.sensor != drivers::VelodyneModel::kHdl64eS2)) {
    setup.stream = Hdl64eStream(options.gps);
    return setup;
  }
  auto stream = Hdl64eStream::with_calibration(setup.sensor, options.return_mode,
                                               options.revolutions_per_minute, options.gps);
  if (!stream) return stream.error();
  auto rounded = drivers::with_stream_calibration(std::move(setup.sensor), *stream->calibration());
  if (!rounded) return rounded.error();
  return LidarSetup{std::move(rounded).value(), std::move(stream).value()};
}

Result<bool> write_inertial_data(const Options& options, const VehicleTrajectory& trajectory,
                                 const fs::path& path) {
  const Result<drivers::ImuPreset> preset = drivers::imu_preset(options.imu);
  if (!preset) return preset.error();
  const Result<ImuFaultConfig> faults = parse_imu_faults(options.imu_faults);
  if (!faults) return faults.error();
  const ImuModelConfig config = imu_config(options);
  const ImuFaults imu_faults(*faults, kStart, trajectory.duration_s(), visit_seed(options));
  const auto write = [&](auto model) {
    return write_imu_recording([&model] { return model.next(); }, model.sample_count(), imu_faults, *preset,
                               path.string());
  };
  const std::optional<ImuGrade> grade = imu_grade_of(options);
  const auto samples =
      grade ? write(GradedImu(*grade, config, trajectory)) : write(ImuModel(config, trajectory));
  if (!samples) return samples.error();
  std::printf("%s: %llu samples\n", path.c_str(), static_cast<unsigned long long>(*samples));
  return true;
}

/// `options.imu` "none" writes no inertial data and removes that of an earlier run.
Result<bool> write_small_files(const Options& options, const VehicleTrajectory& trajectory,
                               const VehicleTrajectory& inertial, const LidarSetup& lidar,
                               const fs::path& folder) {
  const bool with_imu = options.imu != "none";
  const fs::path imu_path = folder / "imu.candump.log";
  const fs::path calibration_path = folder / "calibration.yaml";
  std::error_code ignored;
  fs::remove(imu_path, ignored);
  fs::remove(calibration_path, ignored);
  if (with_imu) {
    const auto imu = write_inertial_data(options, inertial, imu_path);
    if (!imu) return imu.error();
  }
  // Visits have the frame of the town in common.
  const SE3 T_truth_world = options.visit ? SE3{} : trajectory.pose(0.0).inverse();
  const auto truth = write_truth(trajectory, T_truth_world, kStart, (folder / "truth.tum").string());
  if (!truth) return truth.error();
  std::printf("%s: %llu poses\n", (folder / "truth.tum").c_str(), static_cast<unsigned long long>(*truth));
  RecordedSensors sensors;
  sensors.lidar_model = drivers::velodyne_model_name(lidar.sensor.model);
  sensors.lidar = lidar_mounting(options);
  sensors.imu_preset = with_imu ? options.imu : std::string();
  sensors.imu = mounting_of(options.imu_extrinsic);
  if (lidar.stream && lidar.stream->calibration()) {
    const auto written = drivers::write_calibration_yaml(lidar.sensor, calibration_path.string());
    if (!written) return written.error();
    sensors.calibration_file = calibration_path.filename().string();
  }
  return write_configuration(sensors, (folder / "nilio.yaml").string());
}

Result<LidarRecordingSummary> write_lidar(const Options& options, const LidarSetup& setup,
                                          const VehicleTrajectory& trajectory, const RayScene& scene,
                                          const fs::path& path) {
  LidarModelConfig config;
  config.seed = visit_seed(options);
  config.start = kStart;
  config.T_base_lidar = T_base_actual_lidar(options);
  config.revolutions_per_minute = options.revolutions_per_minute;
  config.range_noise_m = options.range_noise_m;
  config.return_mode = options.return_mode;
  config.gps = options.gps;
  config.clock_offset = core::Duration::from_seconds(options.clock_offset_s);
  config.clock_drift_ppm = options.clock_drift_ppm;
  config.network_jitter = core::Duration::from_seconds(options.network_jitter_us * 1e-6);
  config.stream = setup.stream;
  config.realism = options.realism;
  config.effects = effects_of(options);
  config.weather = options.weather;
  config.dirt_deg = options.dirt_deg;
  const LidarModel model(setup.sensor, config, trajectory, scene);
  const PositionModel positions(setup.sensor.model, options.gps, config.T_base_lidar, model.timing(),
                                trajectory);
  return write_lidar_recording(model, sends_position_packets(setup.sensor.model) ? &positions : nullptr,
                               path.string());
}

/// The drive, with the body moving on its wheels if wanted.
VehicleTrajectory make_trajectory(const Options& options, const Scene& scene, const std::vector<SE3>& poses) {
  VehicleTrajectory smooth(poses, kControlIntervalS);
  if (!effects_of(options).has(Effect::kVehicle)) return smooth;
  RoadSurface road = scene.road;
  // The next class of roughness.
  if (options.realism == Realism::kPoor) road.roughness_m3 *= 4.0;
  return smooth.with_body(std::make_shared<BodyMotion>(road, smooth.travel(), visit_seed(options)));
}

}  // namespace

Effects effects_of(const Options& options) {
  if (options.effects) return *options.effects;
  return options.realism == Realism::kIdeal ? Effects::none() : Effects::all();
}

std::optional<ImuGrade> imu_grade_of(const Options& options) {
  if (options.imu_grade || options.imu_constants) return options.imu_grade;
  if (!effects_of(options).has(Effect::kImu)) return std::nullopt;
  return options.realism == Realism::kPoor ? ImuGrade::kAutomotive : ImuGrade::kIndustrial;
}

Result<bool> write_recording(const Options& options) {
  const Result<LidarSetup> setup = make_lidar(options);
  if (!setup) return setup.error();
  const Result<fs::path> folder = prepare_folder(options.output);
  if (!folder) return folder.error();
  Result<Scene> made = make_scene(options, kRecordedLidarMounting.T_base_sensor());
  if (!made) return made.error();
  const VehicleTrajectory trajectory = make_trajectory(options, *made, made->poses);
  const VehicleTrajectory inertial =
      made->inertial_poses.empty() ? trajectory : make_trajectory(options, *made, made->inertial_poses);
  print_drive(path_length(made->poses), trajectory);
  print_scene(*made);
  const Result<RayScene> scene =
      RayScene::create(made->mesh, std::move(made->cars), surface_detail(effects_of(options)));
  if (!scene) return scene.error();

  const fs::path capture = *folder / "lidar.pcap";
  const UnfinishedFile unfinished(capture);
  // The small files first: errors of the folder appear at once.
  const Result<bool> small_files = write_small_files(options, trajectory, inertial, *setup, *folder);
  if (!small_files) return small_files.error();
  const Result<LidarRecordingSummary> lidar =
      write_lidar(options, *setup, trajectory, *scene, unfinished.path());
  if (!lidar) return lidar.error();
  if (auto finished = unfinished.finish(); !finished) return finished.error();
  print_lidar(*lidar, capture);
  return true;
}

}  // namespace nilio::tools::simulate
