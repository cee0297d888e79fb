#include "core/src/estimation/inertial_velocity.hpp"

#include "core/src/estimation/twist_filter.hpp"
#include "tests/support/synthetic_imu_drive.hpp"

#include <cmath>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;
using Drive = nilio::tests::SyntheticImuDrive;

namespace {

constexpr double kScanSeconds = 0.1;
constexpr double kSampleSeconds = 0.0025;

/// Thirty seconds at 10 Hz, with velocities of that noise, m/s.
struct Run {
  int followed = 0;  ///< scans of the last twenty seconds for which there was an acceleration
  double held_square = 0.0;
  double imu_square = 0.0;
};

RegisteredMotion motion_of(double from, double to) {
  return {Time::from_seconds(from),
          Time::from_seconds(to),
          {Drive::rotation(from), Vector3::Zero()},
          {Drive::rotation(to), Vector3::Zero()}};
}

/// `configured` turns the IMU's axes to those of base_link.
Run run(const Drive& drive, double noise, bool by_gyro, const Eigen::Quaterniond& configured) {
  ImuBuffer imu(20'000);
  for (double t = 0.0; t < 31.0; t += kSampleSeconds) imu.add(drive.sample(t), configured);
  InertialVelocity increment(drive.T_base_imu.translation, Duration::from_seconds(0.1));
  std::mt19937 random(7);
  std::normal_distribution<double> normal(0.0, noise);
  Run result;
  for (double t = 0.2; t < 30.0; t += kScanSeconds) {
    const double middle = t + 0.5 * kScanSeconds;
    TurnRate rate{imu, Vector3::Zero(), {}};
    if (!by_gyro) rate.held = Vector3(0.0, 0.0, Drive::rate(middle));
    const Vector3 truth(Drive::speed(middle), 0.0, 0.0);
    increment.update(rate, motion_of(t, t + kScanSeconds),
                     truth + Vector3(normal(random), normal(random), normal(random)), Vector3::Ones(), false);
    const double next = middle + kScanSeconds;
    const auto acceleration = increment.acceleration(
        rate, Time::from_seconds(middle), Time::from_seconds(next), Drive::rotation(middle), truth);
    if (t < 10.0 || !acceleration) continue;
    const Vector3 later(Drive::speed(next), 0.0, 0.0);
    ++result.followed;
    result.held_square += (later - truth).squaredNorm();
    result.imu_square += (later - truth - *acceleration * kScanSeconds).squaredNorm();
  }
  return result;
}

}  // namespace

TEST_CASE("a change of speed is measured through bends, a tilted odom, a lever arm and a bias",
          "[inertial_velocity]") {
  for (const bool by_gyro : {true, false}) {
    INFO(by_gyro);
    const Drive drive;
    const Run exact = run(drive, 0.02, by_gyro, drive.T_base_imu.rotation);
    CHECK(exact.followed > 190);
    CHECK(exact.imu_square < 0.02 * exact.held_square);
    // Velocity errors as large as the change of speed in three scans.
    const Run noisy = run(drive, 0.5, by_gyro, drive.T_base_imu.rotation);
    CHECK(noisy.imu_square < 0.3 * noisy.held_square);
  }
}

TEST_CASE("an accelerometer with wrong axes, sign or unit is not used", "[inertial_velocity]") {
  for (const double scale : {-1.0, 1.0 / 9.81, 9.81}) {
    INFO(scale);
    Drive drive;
    drive.scale = scale;
    CHECK(run(drive, 0.05, true, drive.T_base_imu.rotation).followed == 0);
  }
  const Drive drive;
  const Eigen::Quaterniond left_for_forward = so3_exp(Vector3(0.0, 0.0, 1.5708));
  CHECK(run(drive, 0.05, true, left_for_forward * drive.T_base_imu.rotation).followed == 0);
}

TEST_CASE("the accelerometer follows braking at 1 g where a constant velocity lags", "[inertial_velocity]") {
  constexpr double kBraking = -9.81;
  const auto worst = [](const std::optional<Vector3>& acceleration) {
    TwistFilter filter;
    Vector6 twist = Vector6::Zero();
    twist[0] = 20.0;
    filter.reset(twist);
    double error = 0.0;
    for (int scan = 1; scan <= 15; ++scan) {
      const TwistStep step{kScanSeconds, acceleration};
      twist[0] += kBraking * kScanSeconds;
      error = std::max(error, std::abs(filter.predict(step)[0] - twist[0]));
      Vector6 mean = twist;
      mean[0] -= 0.5 * kBraking * kScanSeconds;
      filter.update(mean, Vector6::Ones(), step);
    }
    return error;
  };
  CHECK(worst(Vector3(kBraking, 0.0, 0.0)) < 1e-9);
  CHECK(worst(std::nullopt) > 0.5);
}
