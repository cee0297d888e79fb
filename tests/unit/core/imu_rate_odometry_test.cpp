#include "core/src/estimation/imu_rate_odometry.hpp"

#include "tests/support/synthetic_imu_drive.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio::core;
using Drive = nilio::tests::SyntheticImuDrive;

namespace {

constexpr double kSampleSeconds = 0.0025;
const Vector3 kBias(0.01, -0.02, 0.015);

/// A vehicle that goes at `speed` round a circle, turning with `rate` about its z axis, from the origin.
struct Circle {
  double speed = 10.0;
  double rate = 0.5;

  [[nodiscard]] SE3 pose(double seconds) const {
    const double yaw = rate * seconds;
    const double radius = speed / rate;
    return {so3_exp(Vector3(0.0, 0.0, yaw)),
            Vector3(radius * std::sin(yaw), radius * (1.0 - std::cos(yaw)), 0.0)};
  }
  [[nodiscard]] ScanPose scan(double seconds) const {
    ScanPose scan;
    scan.state.time = Time::from_seconds(seconds);
    scan.state.T_map_base = pose(seconds);
    scan.state.velocity = {speed, 0.0, 0.0};
    scan.state.angular_velocity = {0.0, 0.0, rate};
    scan.state.gyro_bias = kBias;
    scan.gyro_used = true;
    return scan;
  }
};

/// Sample of an IMU mounted as `T_base_imu`, with its bias in base_link, at `seconds` of its clock.
ImuSample sample(const SE3& T_base_imu, double rate, double seconds) {
  const Vector3 gyro = T_base_imu.rotation.conjugate() * (Vector3(0.0, 0.0, rate) + kBias);
  return {Time::from_seconds(seconds), {gyro.x(), gyro.y(), gyro.z()}, {0.0, 0.0, 9.81}};
}

double distance(const SE3& a, const SE3& b) { return (a.translation - b.translation).norm(); }
double angle(const SE3& a, const SE3& b) { return so3_log(a.rotation.conjugate() * b.rotation).norm(); }

}  // namespace

TEST_CASE("a pose follows a circle by the gyro, whatever the IMU's mounting and time shift",
          "[imu_rate_odometry]") {
  ImuRateOdometryConfig config;
  config.T_base_imu.rotation = so3_exp(Vector3(0.3, -1.1, 2.0));
  const Circle circle;
  const double shift_s = 0.012;
  ImuRateOdometry propagator(config);
  ScanPose scan = circle.scan(0.0);
  scan.state.angular_velocity.setZero();  // the gyro alone has to tell
  scan.imu_time_shift = Duration::from_seconds(shift_s);
  propagator.set_scan_pose(scan);
  int poses = 0;
  for (int i = 1; i < 800; ++i) {
    const double t = kSampleSeconds * i;
    const auto pose = propagator.add(sample(config.T_base_imu, circle.rate, t + shift_s));
    REQUIRE(pose.has_value());
    ++poses;
    REQUIRE(std::abs((pose->stamp - Time::from_seconds(t)).ns) <= 1);
    // Chords for arcs: their shortfall is (rate dt)^2 / 24 of the way.
    REQUIRE(distance(pose->T_odom_base, circle.pose(t)) < 1e-5);
    REQUIRE(angle(pose->T_odom_base, circle.pose(t)) < 1e-9);
    REQUIRE((pose->angular_velocity - Vector3(0.0, 0.0, circle.rate)).norm() < 1e-12);
    REQUIRE(pose->linear_velocity == scan.state.velocity);
    REQUIRE(pose->follows_gyro);
  }
  CHECK(poses == 799);
}

TEST_CASE("a late scan pose gives the same poses as one in time", "[imu_rate_odometry]") {
  const Circle circle;
  const ImuRateOdometryConfig config;
  ImuRateOdometry in_time(config);
  ImuRateOdometry late(config);
  for (double t = -0.1; t < 0.0; t += kSampleSeconds) {
    CHECK_FALSE(in_time.add(sample(config.T_base_imu, circle.rate, t)).has_value());
    CHECK_FALSE(late.add(sample(config.T_base_imu, circle.rate, t)).has_value());
  }
  const ScanPose scan = circle.scan(0.0011);  // between two samples
  in_time.set_scan_pose(scan);
  std::optional<PropagatedPose> expected;
  std::optional<PropagatedPose> found;
  for (double t = 0.0; t < 3.0; t += kSampleSeconds) {
    const ImuSample next = sample(config.T_base_imu, circle.rate + 0.1 * std::sin(t), t);
    expected = in_time.add(next);
    if (t > 2.9) late.set_scan_pose(scan);
    found = late.add(next);
  }
  REQUIRE(expected.has_value());
  REQUIRE(found.has_value());
  CHECK(found->T_odom_base.translation == expected->T_odom_base.translation);
  CHECK(found->T_odom_base.rotation.coeffs() == expected->T_odom_base.rotation.coeffs());
}

namespace {

ScanPose scan_of(const Drive& drive, double t, const Vector3& position) {
  ScanPose scan;
  scan.state.time = Time::from_seconds(t);
  scan.state.T_map_base = {so3_exp(Vector3(0.0, 0.0, Drive::yaw(t))), position};
  scan.state.velocity = {Drive::speed(t), 0.0, 0.0};
  scan.state.angular_velocity = {0.0, 0.0, Drive::rate(t)};
  scan.state.accelerometer_bias = {0.02, -0.01, 0.03};
  scan.state.gravity = drive.tilt * Vector3(0.0, 0.0, -9.81);
  scan.gyro_used = true;
  return scan;
}

struct DriveErrors {
  double largest_m = 0.0;
  double largest_m_s = 0.0;
};

/// Thirty seconds with a scan every half a second.
DriveErrors run(bool accelerometer_used) {
  const Drive drive;
  ImuRateOdometryConfig config;
  config.T_base_imu = drive.T_base_imu;
  ImuRateOdometry propagator(config);
  DriveErrors errors;
  Vector3 position = Vector3::Zero();
  for (int i = 0; i <= 12'000; ++i) {
    const double t = kSampleSeconds * i;
    const double middle = t - 0.5 * kSampleSeconds;
    if (i > 0)
      position += kSampleSeconds * Drive::speed(middle) *
                  Vector3(std::cos(Drive::yaw(middle)), std::sin(Drive::yaw(middle)), 0.0);
    const auto pose = propagator.add(drive.sample(t));
    if (pose) {
      errors.largest_m = std::max(errors.largest_m, (pose->T_odom_base.translation - position).norm());
      errors.largest_m_s =
          std::max(errors.largest_m_s, (pose->linear_velocity - Vector3(Drive::speed(t), 0.0, 0.0)).norm());
    }
    if (i % 200 != 0) continue;
    ScanPose scan = scan_of(drive, t, position);
    scan.accelerometer_used = accelerometer_used;
    propagator.set_scan_pose(scan);
  }
  return errors;
}

}  // namespace

TEST_CASE("an accelerometer that the odometry uses is followed, with tilt, bias and lever arm",
          "[imu_rate_odometry]") {
  const DriveErrors errors = run(true);
  CHECK(errors.largest_m < 1e-3);
  CHECK(errors.largest_m_s < 1e-3);
  // A constant velocity errs by up to 2.4 m/s^2 for half a second.
  CHECK(run(false).largest_m > 0.25);
  CHECK(run(false).largest_m < 0.35);
}

TEST_CASE("an IMU that is not used only gives the time, and the scan's twist is constant",
          "[imu_rate_odometry]") {
  const Circle circle;
  const ImuRateOdometryConfig config;
  ImuRateOdometry propagator(config);
  ScanPose scan = circle.scan(0.0);
  scan.gyro_used = false;
  propagator.set_scan_pose(scan);
  for (double t = kSampleSeconds; t < 1.0; t += kSampleSeconds) {
    const auto pose = propagator.add(sample(config.T_base_imu, -3.0, t));
    REQUIRE(pose.has_value());
    REQUIRE(distance(pose->T_odom_base, circle.pose(t)) < 1e-5);
    REQUIRE_FALSE(pose->follows_gyro);
  }
}

TEST_CASE("a gap in the samples is bridged at the scan's twist, and the gyro is used again after it",
          "[imu_rate_odometry]") {
  const Circle circle;
  const ImuRateOdometryConfig config;
  ImuRateOdometry propagator(config);
  ScanPose scan = circle.scan(0.0);
  propagator.set_scan_pose(scan);
  for (const double t : {0.0025, 0.005, 0.305, 0.3075}) {
    // Rates at the ends of the gap that would be a wrong interpolation across it.
    const double rate = t > 0.1 && t < 0.306 ? 40.0 : circle.rate;
    const auto pose = propagator.add(sample(config.T_base_imu, rate, t));
    REQUIRE(pose.has_value());
    CHECK(pose->follows_gyro == (t < 0.1));
    if (t < 0.306) CHECK(angle(pose->T_odom_base, circle.pose(t)) < 1e-9);
    if (t > 0.306) CHECK(angle(pose->T_odom_base, circle.pose(0.305)) == Approx(0.5 * (40.0 + 0.5) * 0.0025));
  }
}

TEST_CASE("samples from before the scan, out of order, not finite or long after it give no pose",
          "[imu_rate_odometry]") {
  const Circle circle;
  const ImuRateOdometryConfig config;
  ImuRateOdometry propagator(config);
  const auto add = [&](double t) {
    return propagator.add(sample(config.T_base_imu, circle.rate, t)).has_value();
  };
  CHECK_FALSE(add(0.9));
  propagator.set_scan_pose(circle.scan(1.0));
  CHECK_FALSE(add(0.95));
  CHECK(add(1.01));
  CHECK_FALSE(add(1.01));
  CHECK_FALSE(add(1.005));
  ImuSample broken = sample(config.T_base_imu, circle.rate, 1.02);
  broken.angular_velocity[1] = std::numeric_limits<double>::quiet_NaN();
  CHECK_FALSE(propagator.add(broken).has_value());
  CHECK(add(1.02));
  CHECK(add(5.99));
  CHECK_FALSE(add(6.01));
  propagator.set_scan_pose(circle.scan(6.0));
  CHECK(add(6.02));
}

TEST_CASE("the covariance grows with the square of the age, along the axes of the vehicle",
          "[imu_rate_odometry]") {
  Matrix6 pose = Matrix6::Identity() * 1e-4;
  Matrix6 twist = Matrix6::Zero();
  twist(0, 0) = 0.04;  // 0.2 m/s forward
  const Eigen::Quaterniond left = so3_exp(Vector3(0.0, 0.0, 1.5707963267948966));
  const Matrix6 grown = propagated_covariance(pose, twist, left, Duration::from_seconds(0.5));
  CHECK(grown(0, 0) == Approx(1e-4));
  CHECK(grown(1, 1) == Approx(1e-4 + 0.01));
  CHECK((grown - grown.transpose()).norm() < 1e-12);
}
