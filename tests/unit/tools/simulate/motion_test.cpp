#include "nilio/core/se3.hpp"

#include "tests/support/tools/simulate_support.hpp"
#include "tools/simulate/sensors/imu_model.hpp"
#include "tools/simulate/town/town_drive.hpp"
#include "tools/simulate/vehicle/recorded_drive.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <cmath>
#include <fstream>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools::simulate;
using core::SE3;
using core::Vector3;

namespace {

VehicleTrajectory town_trajectory(double duration_s) {
  TownDriveConfig config;
  config.extent.duration_s = duration_s;
  return {make_town_drive(config), kControlIntervalS};
}

ImuModelConfig perfect_imu(double rate_hz) {
  ImuModelConfig config;
  config.rate_hz = rate_hz;
  config.T_base_imu.translation = {-0.8, 0.3, 0.9};
  config.T_base_imu.rotation = core::so3_exp({0.02, -0.03, 0.05});
  return config;
}

Vector3 to_vector(const std::array<double, 3>& a) { return {a[0], a[1], a[2]}; }

/// Camera poses of a bend driven at 10 m/s, as a KITTI file.
std::vector<SE3> write_bend(const std::filesystem::path& path, std::size_t count) {
  const SE3 T_camera_lidar = default_kitti_calibration();
  std::vector<SE3> lidar_poses;
  std::ofstream file(path);
  file.precision(12);
  for (std::size_t i = 0; i < count; ++i) {
    const double angle = 0.04 * static_cast<double>(i);
    lidar_poses.push_back(
        {core::so3_exp({0.0, 0.0, angle}), {26.0 * std::sin(angle), 26.0 * (1.0 - std::cos(angle)), 0.0}});
    const Eigen::Matrix4d m = (T_camera_lidar * lidar_poses.back() * T_camera_lidar.inverse()).matrix();
    for (Eigen::Index k = 0; k < 12; ++k) file << m(k / 4, k % 4) << (k == 11 ? '\n' : ' ');
  }
  return lidar_poses;
}

RecordedDriveConfig recorded_config(const std::filesystem::path& path) {
  RecordedDriveConfig config;
  config.pose_file = path.string();
  config.pose_interval_s = 0.1;
  config.T_base_lidar.translation = {0.0, 0.0, 1.73};
  return config;
}

}  // namespace

TEST_CASE("velocity, acceleration and angular rates are the derivatives of the pose", "[simulate_motion]") {
  const VehicleTrajectory trajectory = town_trajectory(25.0);
  constexpr double step = 1e-4;
  for (double t = 0.513; t < 24.0; t += 0.397) {
    const MotionState before = trajectory.state(t - step);
    const MotionState here = trajectory.state(t);
    const MotionState after = trajectory.state(t + step);
    const Vector3 velocity =
        (after.T_world_base.translation - before.T_world_base.translation) / (2.0 * step);
    const Vector3 acceleration = (after.velocity - before.velocity) / (2.0 * step);
    const Vector3 rate =
        core::so3_log(before.T_world_base.rotation.conjugate() * after.T_world_base.rotation) / (2.0 * step);
    const Vector3 angular_acceleration = (after.angular_velocity - before.angular_velocity) / (2.0 * step);
    CHECK((velocity - here.velocity).norm() < 1e-5);
    CHECK((acceleration - here.acceleration).norm() < 1e-3);
    CHECK((rate - here.angular_velocity).norm() < 1e-5);
    CHECK((angular_acceleration - here.angular_acceleration).norm() < 1e-2);
  }
}

TEST_CASE("the town drive is stationary, accelerates, keeps its speed and heads along its motion",
          "[simulate_motion]") {
  const std::vector<SE3> poses = make_town_drive({});
  const VehicleTrajectory trajectory(poses, kControlIntervalS);
  CHECK(path_length(poses) == Approx(650.0).margin(60.0));
  CHECK(trajectory.state(1.0).velocity.norm() < 1e-9);
  double fastest = 0.0;
  for (double t = 0.0; t < trajectory.duration_s(); t += 0.1) {
    const MotionState state = trajectory.state(t);
    const double speed = state.velocity.norm();
    fastest = std::max(fastest, speed);
    CHECK(state.acceleration.head<2>().norm() < 4.5);
    if (speed < 1.0) continue;
    const Vector3 in_base = state.T_world_base.rotation.conjugate() * state.velocity;
    CHECK(std::abs(std::atan2(in_base.y(), in_base.x())) < 0.02);
  }
  CHECK(fastest == Approx(10.0).margin(0.5));
  const Vector3 gap = poses.back().translation - poses.front().translation;
  CHECK(gap.norm() < 10.0);
}

TEST_CASE("a moving start is at speed immediately, and length and duration limit the drive",
          "[simulate_motion]") {
  TownDriveConfig config;
  config.moving_start = true;
  config.extent.length_m = 80.0;
  const std::vector<SE3> by_length = make_town_drive(config);
  CHECK(path_length(by_length) == Approx(80.0).margin(1.0));
  CHECK(VehicleTrajectory(by_length, kControlIntervalS).state(0.0).velocity.norm() ==
        Approx(10.0).margin(0.2));
  config.extent = {0.0, 7.5};
  CHECK(VehicleTrajectory(make_town_drive(config), kControlIntervalS).duration_s() == Approx(7.5));
  config.extent = {2500.0, 0.0};
  CHECK(path_length(make_town_drive(config)) == Approx(2500.0).margin(5.0));
}

TEST_CASE("a drive that ends while moving ends on its wheels", "[simulate_motion]") {
  TownDriveConfig config;
  config.moving_start = true;
  config.extent = {0.0, 7.5};
  const VehicleTrajectory drive(make_town_drive(config), kControlIntervalS);
  for (double before_end = 0.0; before_end < 0.3; before_end += 0.01) {
    const SE3 pose = drive.pose(7.5 - before_end);
    CHECK((pose.rotation * Vector3::UnitZ()).z() > 0.98);
  }
}

TEST_CASE("the samples of an ideal gyroscope integrate to the true orientation", "[simulate_motion]") {
  const VehicleTrajectory trajectory = town_trajectory(30.0);
  constexpr double rate = 1000.0;
  const ImuModelConfig config = perfect_imu(rate);
  ImuModel imu(config, trajectory);
  const auto T_world_imu = [&](double t) { return trajectory.pose(t) * config.T_base_imu; };
  Eigen::Quaterniond orientation = T_world_imu(0.0).rotation;
  core::ImuSample previous = imu.next();
  for (std::uint64_t i = 1; i < imu.sample_count(); ++i) {
    const core::ImuSample sample = imu.next();
    const Vector3 mean = 0.5 * (to_vector(previous.angular_velocity) + to_vector(sample.angular_velocity));
    orientation = (orientation * core::so3_exp(mean / rate)).normalized();
    previous = sample;
  }
  const Eigen::Quaterniond truth = T_world_imu(trajectory.duration_s()).rotation;
  CHECK(core::so3_log(orientation.conjugate() * truth).norm() < 1e-4);
}

TEST_CASE("an ideal accelerometer measures the specific force at its own place", "[simulate_motion]") {
  const VehicleTrajectory trajectory = town_trajectory(25.0);
  const ImuModelConfig config = perfect_imu(200.0);
  ImuModel imu(config, trajectory);
  constexpr double step = 1e-3;
  for (std::uint64_t i = 0; i + 1 < imu.sample_count(); ++i) {
    const Vector3 force = to_vector(imu.next().linear_acceleration);
    const double t = static_cast<double>(i) / config.rate_hz;
    if (i % 37 != 5) continue;
    const auto place = [&](double time) -> Vector3 {
      return (trajectory.pose(time) * config.T_base_imu).translation;
    };
    const Vector3 acceleration = (place(t + step) - 2.0 * place(t) + place(t - step)) / (step * step);
    const Eigen::Quaterniond rotation = (trajectory.pose(t) * config.T_base_imu).rotation;
    const Vector3 expected = rotation.conjugate() * (acceleration + Vector3(0.0, 0.0, 9.81));
    CHECK((force - expected).norm() < 0.03);
  }
}

TEST_CASE("a stationary IMU measures gravity and no rotation, with the configured noise and bias",
          "[simulate_motion]") {
  const std::vector<SE3> stationary(400, SE3::identity());
  const VehicleTrajectory trajectory(stationary, kControlIntervalS);
  ImuModelConfig config;
  config.gyroscope = {1e-4, 2e-3, 0.0};
  config.accelerometer = {1e-3, 0.02, 0.0};
  ImuModel imu(config, trajectory);
  const auto count = static_cast<double>(imu.sample_count());
  REQUIRE(count > 3900.0);
  Vector3 rate = Vector3::Zero();
  Vector3 force = Vector3::Zero();
  double rate_square = 0.0;
  for (std::uint64_t i = 0; i < imu.sample_count(); ++i) {
    const core::ImuSample sample = imu.next();
    rate += to_vector(sample.angular_velocity) / count;
    force += to_vector(sample.linear_acceleration) / count;
    rate_square += sample.angular_velocity[0] * sample.angular_velocity[0] / count;
  }
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    CHECK(std::abs(rate[axis]) == Approx(2e-3).margin(1e-4));
    CHECK(std::abs(force[axis] - (axis == 2 ? 9.81 : 0.0)) == Approx(0.02).margin(2e-3));
  }
  const double deviation = std::sqrt(rate_square - rate[0] * rate[0]);
  CHECK(deviation == Approx(1e-4 * std::sqrt(200.0)).epsilon(0.1));
}

TEST_CASE("a recorded drive follows the recorded poses, as base_link under the LiDAR", "[simulate_motion]") {
  const tests::TemporaryFolder folder;
  const auto path = folder.path() / "poses.txt";
  const std::vector<SE3> lidar_poses = write_bend(path, 120);
  RecordedDriveConfig config = recorded_config(path);
  config.moving_start = true;
  const auto poses = make_recorded_drive(config);
  REQUIRE(poses.ok());
  const VehicleTrajectory trajectory(*poses, kControlIntervalS);
  CHECK(trajectory.duration_s() == Approx(11.9).margin(0.1));
  for (std::size_t i = 3; i + 4 < lidar_poses.size(); ++i) {
    const SE3 base = trajectory.pose(0.1 * static_cast<double>(i));
    // World is the base at the first pose, so that the LiDAR's height cancels.
    CHECK((base.translation - lidar_poses[i].translation).norm() < 0.1);
    CHECK(core::so3_log(base.rotation.conjugate() * lidar_poses[i].rotation).norm() < 0.002);
  }
  config.moving_start = false;
  const auto from_standing = make_recorded_drive(config);
  REQUIRE(from_standing.ok());
  const VehicleTrajectory started(*from_standing, kControlIntervalS);
  CHECK(started.state(1.5).velocity.norm() < 1e-9);
  CHECK(started.state(started.duration_s() - 0.5).velocity.norm() == Approx(10.4).margin(0.2));
}

TEST_CASE("drifting recorded heights are made consistent at revisited places", "[simulate_motion]") {
  // Three rounds of a circle that climbs 0.5 m per round.
  std::vector<SE3> poses;
  constexpr double turn = 2.0 * 3.14159265358979;
  for (double turned = 0.0; turned < 3.0 * turn; turned += 0.02) {
    poses.push_back({core::so3_exp({0.0, 0.0, turned}),
                     {50.0 * std::sin(turned), 50.0 * (1.0 - std::cos(turned)), 0.5 * turned / turn}});
  }
  const std::vector<SE3> before = poses;
  close_heights(poses);
  const auto round = static_cast<std::size_t>(turn / 0.02);
  for (std::size_t i = 0; i + 2 * round + 2 < poses.size(); i += 10) {
    CHECK(std::abs(poses[i].translation.z() - poses[i + round].translation.z()) < 0.1);
    CHECK(std::abs(poses[i].translation.z() - poses[i + 2 * round].translation.z()) < 0.1);
    CHECK(poses[i].translation.head<2>() == before[i].translation.head<2>());
  }
  for (std::size_t i = 1; i < poses.size(); ++i) {
    CHECK(std::abs(poses[i].translation.z() - poses[i - 1].translation.z()) < 0.05);
  }
}

TEST_CASE("a bad pose file is rejected with file, place and remedy", "[simulate_motion]") {
  const tests::TemporaryFolder folder;
  const auto path = folder.path() / "poses.txt";
  write_bend(path, 20);
  const RecordedDriveConfig config = recorded_config(path);
  const auto message = [&] {
    const auto result = make_recorded_drive(config);
    return result.ok() ? std::string() : result.error().message;
  };
  SECTION("a line with too few numbers") {
    std::ofstream(path, std::ios::app) << "1 0 0 0 0 1 0\n";
    CHECK_THAT(message(), Catch::Contains(path.string()) && Catch::Contains("21"));
  }
  SECTION("a jump") {
    std::ofstream(path, std::ios::app) << "1 0 0 5000 0 1 0 0 0 0 1 0\n";
    CHECK_THAT(message(), Catch::Contains("pose 21") && Catch::Contains("--pose-interval"));
  }
  SECTION("times in front, as TUM has them") {
    std::ofstream(path) << "1.0 0 0 0 0 0 0 1\n2.0 0 0 0 0 0 0 1\n";
    CHECK_THAT(message(), Catch::Contains("TUM"));
  }
  SECTION("too short") {
    write_bend(path, 3);
    CHECK_THAT(message(), Catch::Contains("at least 4"));
  }
  SECTION("missing") {
    std::filesystem::remove(path);
    CHECK_THAT(message(), Catch::Contains(path.string()));
  }
}
