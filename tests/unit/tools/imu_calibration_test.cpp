#include "tools/inspect/imu_calibration/imu_calibration.hpp"

#include "nilio/core/units.hpp"

#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio::core;
using namespace nilio::tools::inspect;

namespace {

constexpr double kScanPeriod = 0.1;
constexpr double kSamplePeriod = 0.005;

using Drive = std::function<SE3(double)>;

/// Bends to both sides with braking and acceleration, on a level road.
SE3 winding(double t) {
  const double along = 8.0 * t + 3.0 * std::sin(0.6 * t);
  const double yaw = 0.8 * std::sin(0.35 * t) + 0.2 * std::sin(0.9 * t);
  // Close enough to the heading for the forces that belong to it.
  return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Vector3::UnitZ())),
          Vector3(along, 15.0 * std::sin(0.35 * t), 0.0)};
}

SE3 straight(double t) { return {Eigen::Quaterniond::Identity(), Vector3(10.0 * t, 0.0, 0.0)}; }

std::vector<RegisteredMotion> motions_of(const Drive& drive, double seconds) {
  std::vector<RegisteredMotion> motions;
  for (double t = 1.0; t < seconds; t += kScanPeriod) {
    RegisteredMotion motion;
    motion.from = Time::from_seconds(t);
    motion.to = Time::from_seconds(t + kScanPeriod);
    motion.T_odom_from = drive(motion.from.seconds());
    motion.T_odom_to = drive(motion.to.seconds());
    // Stamps are whole nanoseconds; consecutive motions share one.
    if (!motions.empty()) {
      motion.from = motions.back().to;
      motion.T_odom_from = motions.back().T_odom_to;
    }
    motions.push_back(motion);
  }
  return motions;
}

ImuSample sample_at(const Drive& drive, double t, const SE3& T_base_imu) {
  constexpr double kStep = 1e-3;
  const SE3 before = drive(t - kStep) * T_base_imu;
  const SE3 now = drive(t) * T_base_imu;
  const SE3 after = drive(t + kStep) * T_base_imu;
  const Vector3 rate = so3_log(before.rotation.conjugate() * after.rotation) / (2.0 * kStep);
  const Vector3 acceleration =
      (after.translation - 2.0 * now.translation + before.translation) / (kStep * kStep);
  const Vector3 force = now.rotation.conjugate() * (acceleration + Vector3(0.0, 0.0, 9.81));
  return {Time::from_seconds(t), {rate.x(), rate.y(), rate.z()}, {force.x(), force.y(), force.z()}};
}

SE3 rotated(double roll_deg, double pitch_deg, double yaw_deg) {
  const Eigen::Quaterniond rotation =
      Eigen::AngleAxisd(yaw_deg * nilio::kRadiansPerDegree, Vector3::UnitZ()) *
      Eigen::AngleAxisd(pitch_deg * nilio::kRadiansPerDegree, Vector3::UnitY()) *
      Eigen::AngleAxisd(roll_deg * nilio::kRadiansPerDegree, Vector3::UnitX());
  return {rotation, Vector3::Zero()};
}

struct Case {
  Drive drive = winding;
  SE3 actual{};      ///< true mounting
  SE3 configured{};  ///< configured mounting
  std::function<void(ImuSample&)> fault{};
};

ImuCalibration correct(const Case& c, double seconds = 40.0) {
  std::vector<ImuSample> samples;
  for (double t = 0.0; t < seconds + 2.0; t += kSamplePeriod) {
    samples.push_back(sample_at(c.drive, t, c.actual));
    if (c.fault) c.fault(samples.back());
  }
  return calibrate_imu(motions_of(c.drive, seconds), samples, {.T_base_imu = c.configured});
}

Vector3 degrees_of(const ImuCalibration& correction) {
  return roll_pitch_yaw(correction.R_base_imu.toRotationMatrix()) / nilio::kRadiansPerDegree;
}

void scale(std::array<double, 3>& values, double factor) {
  for (double& value : values) value *= factor;
}

/// "xy-z" sends z with the other sign.
using Permutation = std::array<int, 3>;
void send_as(std::array<double, 3>& values, const Permutation& axes) {
  const std::array<double, 3> before = values;
  for (std::size_t i = 0; i < 3; ++i) {
    const double value = before[static_cast<std::size_t>(std::abs(axes[i]) - 1)];
    values[i] = axes[i] < 0 ? -value : value;
  }
}

}  // namespace

TEST_CASE("a correct IMU needs no correction, also with a configured rotated mounting", "[imu_calibration]") {
  for (const SE3& mounting : {SE3::identity(), rotated(3.0, -7.0, 40.0), rotated(180.0, 0.0, 90.0)}) {
    const ImuCalibration correction = correct({.actual = mounting, .configured = mounting});
    CHECK_FALSE(correction.any());
    CHECK(correction.mirror_known);
    CHECK(correction.time_offset_known);
    CHECK(correction.R_base_imu.coeffs() == mounting.rotation.coeffs());
  }
}

TEST_CASE("a mounting that is not configured is found about every axis", "[imu_calibration]") {
  for (const SE3& actual : {rotated(0.0, 0.0, 10.0), rotated(0.0, 10.0, 0.0), rotated(10.0, 0.0, 0.0),
                            rotated(-5.0, 8.0, 130.0)}) {
    const ImuCalibration correction = correct({.actual = actual});
    CHECK(correction.orientation_changed);
    CHECK_FALSE(correction.along_axes);
    CHECK(correction.R_base_imu.angularDistance(actual.rotation) / nilio::kRadiansPerDegree < 1.0);
    for (const double sigma : correction.rotation_sigma) CHECK(sigma < 2.0 * nilio::kRadiansPerDegree);
  }
}

TEST_CASE("a fit near an axis permutation is snapped to it", "[imu_calibration]") {
  const ImuCalibration correction = correct({.actual = rotated(180.0, 0.0, 89.0)});
  CHECK(correction.along_axes);
  const Matrix3 whole = rotated(180.0, 0.0, 90.0).rotation.toRotationMatrix();
  CHECK((correction.R_base_imu.toRotationMatrix() - whole).norm() < 1e-6);
}

TEST_CASE("mirrored axes are corrected by signs and a rotation", "[imu_calibration]") {
  const SE3 mounting = rotated(0.5, -0.3, 0.8);
  for (const Permutation& axes : std::vector<Permutation>{
           {3, 2, 1}, {1, 2, -3}, {-1, -2, -3}, {2, 1, 3}, {-1, 2, 3}, {2, 3, 1}, {-2, 1, 3}}) {
    INFO(axes[0] << axes[1] << axes[2]);
    const auto fault = [&](ImuSample& s) {
      send_as(s.angular_velocity, axes);
      send_as(s.linear_acceleration, axes);
    };
    const ImuCalibration correction = correct({.actual = mounting, .configured = mounting, .fault = fault});
    REQUIRE(correction.orientation_changed);
    CHECK(correction.along_axes);
    CHECK(correction.negate_gyro == correction.negate_accel);
    // The corrected measurement of base_link's axes is base_link's axes.
    for (int k = 0; k < 3; ++k) {
      const Vector3 direction = mounting.rotation.conjugate() * Vector3::Unit(k);
      std::array<double, 3> sent{direction.x(), direction.y(), direction.z()};
      send_as(sent, axes);
      for (std::size_t i = 0; i < 3; ++i)
        if (correction.negate_gyro[i]) sent[i] = -sent[i];
      const Vector3 corrected = correction.R_base_imu * Vector3(sent.data());
      CHECK((corrected - Vector3::Unit(k)).norm() < 1e-6);
    }
  }
}

TEST_CASE("the smallest rotation is chosen among the corrections of mirrored axes", "[imu_calibration]") {
  const auto flip = [](const Permutation& axes) {
    return correct({.fault = [axes](ImuSample& s) {
      send_as(s.angular_velocity, axes);
      send_as(s.linear_acceleration, axes);
    }});
  };
  CHECK(flip({1, 2, -3}).negate_gyro == std::array<bool, 3>{false, false, true});
  CHECK(degrees_of(flip({1, 2, -3})).norm() == Approx(0.0).margin(1e-6));
  CHECK(flip({-1, -2, -3}).negate_gyro == std::array<bool, 3>{true, true, true});
  CHECK(degrees_of(flip({-1, -2, -3})).norm() == Approx(0.0).margin(1e-6));
}

TEST_CASE("a wrong sign of the gyroscope alone is distinguished from a mounting", "[imu_calibration]") {
  const ImuCalibration correction = correct({.fault = [](ImuSample& s) { s.angular_velocity[2] *= -1.0; }});
  CHECK(correction.orientation_changed);
  CHECK(correction.negate_gyro == std::array<bool, 3>{false, false, true});
  CHECK(correction.negate_accel == std::array<bool, 3>{});
  CHECK(degrees_of(correction).norm() == Approx(0.0).margin(1e-9));
}

TEST_CASE("a gyroscope with other axes than its accelerometer is reported as not correctable by a rotation",
          "[imu_calibration]") {
  const ImuCalibration correction =
      correct({.fault = [](ImuSample& s) { std::swap(s.angular_velocity[0], s.angular_velocity[2]); }});
  CHECK(correction.axes_disagree);
  CHECK_FALSE(correction.orientation_changed);
}

TEST_CASE("unit mistakes are recognised by their factor, other scales are estimated", "[imu_calibration]") {
  const auto degrees = correct({.fault = [](ImuSample& s) { scale(s.angular_velocity, 57.29578); }});
  CHECK(degrees.gyro.is_unit);
  CHECK(degrees.gyro.factor == Approx(std::numbers::pi / 180.0));
  const auto radians = correct({.fault = [](ImuSample& s) { scale(s.angular_velocity, 1.0 / 57.29578); }});
  CHECK(radians.gyro.factor == Approx(180.0 / std::numbers::pi));
  const auto g = correct({.fault = [](ImuSample& s) { scale(s.linear_acceleration, 1.0 / 9.80665); }});
  CHECK(g.accel.is_unit);
  CHECK(g.accel.factor == Approx(9.80665));
  CHECK_FALSE(g.orientation_changed);
  const auto low = correct({.fault = [](ImuSample& s) { scale(s.angular_velocity, 0.8); }});
  CHECK_FALSE(low.gyro.is_unit);
  CHECK(low.gyro.factor == Approx(1.25).margin(0.01));
}

TEST_CASE("a time offset is found to a few milliseconds, also beyond the range of one fit",
          "[imu_calibration]") {
  for (const double offset_ms : {-600.0, -100.0, -20.0, 20.0, 100.0, 150.0}) {
    const auto late = [offset_ms](ImuSample& s) {
      s.stamp = s.stamp + Duration::from_milliseconds(offset_ms);
    };
    const ImuCalibration correction = correct({.fault = late});
    INFO(offset_ms);
    REQUIRE(correction.time_offset_known);
    CHECK(1e3 * correction.time_offset_s == Approx(offset_ms).margin(3.0));
    CHECK_FALSE(correction.orientation_changed);
  }
}

TEST_CASE("the residual calibration of a second run is added to the first", "[imu_calibration]") {
  const ImuCalibration first = correct({.actual = rotated(0.0, 0.0, 10.0), .fault = [](ImuSample& s) {
                                          s.stamp = s.stamp + Duration::from_milliseconds(50.0);
                                          scale(s.angular_velocity, 57.29578);
                                          s.angular_velocity[2] *= -1.0;
                                        }});
  REQUIRE(first.gyro.is_unit);
  REQUIRE(first.negate_gyro[2]);
  ImuCalibration rest;
  rest.R_base_imu = rotated(0.0, 0.0, 9.5).rotation;
  rest.orientation_changed = true;
  rest.time_offset_known = true;
  rest.time_offset_s = -4e-3;
  rest.time_offset_sigma_s = 3e-4;
  const ImuCalibration both = refine(first, rest);
  CHECK(1e3 * both.time_offset_s == Approx(46.0).margin(3.0));
  CHECK(both.time_offset_matters);
  CHECK(both.gyro.factor == first.gyro.factor);
  CHECK(both.negate_gyro == first.negate_gyro);
  CHECK(both.R_base_imu.coeffs() == rest.R_base_imu.coeffs());
  rest.time_offset_s = -first.time_offset_s;
  rest.negate_gyro = first.negate_gyro;
  CHECK_FALSE(refine(first, rest).time_offset_matters);
  CHECK_FALSE(refine(first, rest).negate_gyro[2]);
}

TEST_CASE("a straight road at steady speed observes only the vertical axis", "[imu_calibration]") {
  const ImuCalibration level = correct({.drive = straight});
  CHECK_FALSE(level.any());
  CHECK_FALSE(level.gyro.known);
  CHECK_FALSE(level.time_offset_known);
  CHECK_FALSE(level.mirror_known);
  CHECK(std::isfinite(level.rotation_sigma[0]));
  CHECK(std::isfinite(level.rotation_sigma[1]));
  CHECK(std::isinf(level.rotation_sigma[2]));
  const ImuCalibration over = correct({.drive = straight, .actual = rotated(180.0, 0.0, 0.0)});
  CHECK(over.orientation_changed);
  CHECK(std::abs(degrees_of(over).x()) == Approx(180.0).margin(1e-6));
  // The configured yaw is kept where it is not observed.
  const ImuCalibration kept =
      correct({.drive = straight, .actual = rotated(0.0, 20.0, 30.0), .configured = rotated(0.0, 0.0, 30.0)});
  CHECK(degrees_of(kept).z() == Approx(30.0).margin(4.0));
}

TEST_CASE("without samples or motions there is no result and no change", "[imu_calibration]") {
  const SE3 configured = rotated(1.0, 2.0, 3.0);
  const ImuCalibration nothing = calibrate_imu({}, {}, {.T_base_imu = configured});
  CHECK_FALSE(nothing.any());
  CHECK(nothing.R_base_imu.coeffs() == configured.rotation.coeffs());
  CHECK_FALSE(calibrate_imu(motions_of(winding, 20.0), {}, {.T_base_imu = configured}).any());
}

TEST_CASE("roll, pitch and yaw reproduce the rotation, also at gimbal lock", "[imu_calibration]") {
  for (const Vector3& rpy : {Vector3(10, 20, 30), Vector3(-170, 5, 90), Vector3(0, 90, 0),
                             Vector3(0, -90, 45), Vector3(30, 90, 10)}) {
    const Matrix3 wanted = rotated(rpy.x(), rpy.y(), rpy.z()).rotation.toRotationMatrix();
    const Vector3 found = roll_pitch_yaw(wanted) / nilio::kRadiansPerDegree;
    const Matrix3 again = rotated(found.x(), found.y(), found.z()).rotation.toRotationMatrix();
    CHECK((wanted - again).norm() < 1e-4);
  }
}
