#include "core/src/estimation/stationary_detector.hpp"

#include "nilio/core/odometry.hpp"

#include "tests/support/synthetic_room.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;
using nilio::tests::imu_sample;
using nilio::tests::Room;
using nilio::tests::scan_room;

namespace {

constexpr double kForceNoise = 0.02;
constexpr double kGyroNoise = 0.002;

ImuStatistics imu(const Vector3& force) {
  ImuStatistics statistics;
  statistics.count = 40;
  statistics.mean_acceleration = force;
  statistics.acceleration_deviation = std::sqrt(3.0) * kForceNoise;
  statistics.angular_velocity_deviation = std::sqrt(3.0) * kGyroNoise;
  return statistics;
}

const Vector3 kSupport(-0.2, 0.1, 9.8);

/// Stationary for 2 s, then departs with 1.2 m/s^2 that take a second to build up.
double travelled(double t) {
  constexpr double kStart = 2.0;
  constexpr double kAcceleration = 1.2;
  if (t < kStart) return 0.0;
  const double u = t - kStart;
  if (u < 1.0) return kAcceleration * u * u * u / 6.0;
  return kAcceleration * (1.0 / 6.0 + 0.5 * (u - 1.0) + 0.5 * (u - 1.0) * (u - 1.0));
}

SE3 setting_off(double t) { return {Eigen::Quaterniond::Identity(), Vector3(travelled(t), 0.0, 0.0)}; }

/// A tube without ends in which a truck departs with the vehicle; beside its back only a few posts show the
/// motion along the tube.
Room tube_with_truck(double t) {
  Room room;
  room.low = Vector3(-1000.0, -6.0, -1.8);
  room.high = Vector3(1000.0, 7.0, 8.0);
  room.pillars.push_back({25.0 + travelled(t), 1.0, 1.3});
  for (int i = -4; i < 8; ++i) {
    room.pillars.push_back({20.0 * i + 3.0, 5.0, 0.2});
    room.pillars.push_back({20.0 * i + 9.0, -5.0, 0.2});
  }
  return room;
}

double position_behind_truck(double seconds) {
  Odometry odometry{OdometryConfig{}};
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  double end = 0.0;
  int sample = 0;
  for (int i = 0; i < static_cast<int>(seconds * 10.0); ++i) {
    const double start = 0.1 * i;
    for (; 0.005 * sample < start + 0.11; ++sample) {
      ImuSample measured = imu_sample(setting_off, 0.005 * sample, Vector3::Zero());
      for (double& rate : measured.angular_velocity) rate += kGyroNoise * normal(random);
      for (double& force : measured.linear_acceleration) force += kForceNoise * normal(random);
      odometry.add_imu(measured);
    }
    const Scan scan =
        scan_room(tube_with_truck(start + 0.05), setting_off, start, static_cast<std::uint64_t>(i));
    OdometryResult result = odometry.register_scan(scan);
    odometry.update_map(result);
    end = result.T_odom_base.translation.x();
  }
  return end;
}

}  // namespace

TEST_CASE("an idling vehicle is stationary until it departs, and its gravity-and-bias is exact",
          "[stationary_detector]") {
  StationaryDetector start;
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0.0, kForceNoise / std::sqrt(40.0));
  const auto noise = [&] { return Vector3(normal(random), normal(random), normal(random)); };
  for (int scan = 0; scan < 20; ++scan) CHECK(start.observe(imu(kSupport + noise()), true));
  double acceleration = 0.0;
  while (start.observe(imu(kSupport + Vector3(acceleration, 0.0, 0.0) + noise()), true)) acceleration += 0.01;
  CHECK(acceleration < 0.1);
  CHECK((start.mean_force() - kSupport).norm() < 0.02);
  CHECK_FALSE(start.is_stationary());
}

TEST_CASE("a constant acceleration after the departure is not stationary", "[stationary_detector]") {
  StationaryDetector start;
  CHECK(start.observe(imu(kSupport), true));
  for (int scan = 0; scan < 50; ++scan)
    CHECK_FALSE(start.observe(imu(kSupport + Vector3(1.2, 0.0, 0.0)), true));
}

TEST_CASE("offset and scale of a sound accelerometer do not hide that the vehicle is stationary",
          "[stationary_detector]") {
  // 80 mg of offset and 1 % of scale, both up or both down.
  for (const double error : {0.88, -0.88}) {
    StationaryDetector detector;
    CHECK(detector.observe(imu(Vector3(0.0, 0.0, kGravity + error)), true));
  }
}

TEST_CASE("vibration is not stationary, nor is an IMU that is stuck, silent or without gravity",
          "[stationary_detector]") {
  ImuStatistics shaking = imu(kSupport);
  shaking.acceleration_deviation = 0.5;
  ImuStatistics swaying = imu(kSupport);
  swaying.angular_velocity_deviation = 0.05;
  ImuStatistics stuck = imu(kSupport);
  stuck.acceleration_deviation = 0.0;
  const ImuStatistics sideways = imu(Vector3(9.8, 0.1, -0.2));
  const ImuStatistics in_units_of_g = imu(kSupport / 9.81);
  for (const ImuStatistics& statistics : {shaking, swaying, stuck, ImuStatistics{}, sideways, in_units_of_g})
    CHECK_FALSE(StationaryDetector().observe(statistics, true));
}

TEST_CASE("later a vehicle is stationary where it is as quiet as at the start and may be stationary",
          "[stationary_detector]") {
  StationaryDetector stationary_detector;
  for (int scan = 0; scan < 10; ++scan) CHECK(stationary_detector.observe(imu(kSupport), true));
  CHECK(stationary_detector.is_first());
  ImuStatistics rolling = imu(kSupport);
  rolling.acceleration_deviation *= 1.3;
  CHECK_FALSE(stationary_detector.observe(imu(kSupport + Vector3(0.5, 0.0, 0.0)), true));
  CHECK_FALSE(stationary_detector.is_first());
  for (int scan = 0; scan < 10; ++scan) CHECK_FALSE(stationary_detector.observe(rolling, true));
  CHECK_FALSE(stationary_detector.observe(imu(kSupport), false));
  // Another slope of the road.
  const Vector3 on_slope(0.8, 0.1, 9.75);
  CHECK(stationary_detector.observe(imu(on_slope), true));
  CHECK(stationary_detector.has_begun());
  CHECK(stationary_detector.observe(imu(on_slope), false));
  CHECK_FALSE(stationary_detector.observe(rolling, true));
  stationary_detector.contradict();
  CHECK_FALSE(stationary_detector.observe(imu(kSupport), true));
}

TEST_CASE("a vehicle that was not stationary at the start is never taken to be", "[stationary_detector]") {
  StationaryDetector stationary_detector;
  ImuStatistics driving = imu(kSupport);
  driving.acceleration_deviation = 0.5;
  CHECK_FALSE(stationary_detector.observe(driving, true));
  for (int scan = 0; scan < 50; ++scan) CHECK_FALSE(stationary_detector.observe(imu(kSupport), true));
}

TEST_CASE("a truck that departs with the vehicle does not hold the pose, with an IMU",
          "[stationary_detector]") {
  const double truth = travelled(6.0);
  REQUIRE(truth > 7.0);
  CHECK(std::abs(position_behind_truck(6.0) - truth) < 0.05 * truth);
}
