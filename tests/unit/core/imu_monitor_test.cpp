#include "core/src/imu_monitor/imu_monitor.hpp"

#include "nilio/core/units.hpp"

#include "tests/support/imu_fault.hpp"
#include "tests/support/synthetic_room.hpp"

#include <algorithm>
#include <functional>
#include <limits>
#include <optional>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;
using nilio::tests::changed;
using nilio::tests::imu_sample;
using nilio::tests::ImuFault;

namespace {

constexpr double kScanPeriod = 0.1;
constexpr double kSamplePeriod = 0.005;

/// Turns to both sides with some pitch and roll, accelerates and brakes.
SE3 winding_road(double t) {
  const Eigen::Quaterniond rotation =
      Eigen::AngleAxisd(0.6 * std::sin(0.5 * t) + 0.3 * std::sin(0.9 * t), Vector3::UnitZ()) *
      Eigen::AngleAxisd(0.03 * std::sin(0.7 * t), Vector3::UnitY()) *
      Eigen::AngleAxisd(0.02 * std::sin(1.1 * t), Vector3::UnitX());
  return {rotation,
          Vector3(8.0 * t + 6.0 * std::sin(0.5 * t), 10.0 * std::sin(0.4 * t), 0.3 * std::sin(0.3 * t))};
}

struct Drive {
  double seconds = 40.0;
  ImuFault fault = [](const ImuSample& sample) { return std::optional(sample); };
  std::function<SE3(double)> pose = winding_road;
};

/// The monitor's findings on a drive whose poses are registered to 5 mm and 0.01 deg.
ImuHealth watch(const Drive& drive) {
  std::mt19937_64 generator(5);
  std::normal_distribution<double> normal;
  const auto noise = [&](double sigma) {
    return Vector3(sigma * normal(generator), sigma * normal(generator), sigma * normal(generator));
  };
  ImuBuffer buffer(4096);
  ImuMonitor monitor({});
  SE3 previous = drive.pose(0.0);
  double sample_time = -0.5;
  for (double end = kScanPeriod; end < drive.seconds; end += kScanPeriod) {
    for (; !buffer.latest() || *buffer.latest() < Time::from_seconds(end); sample_time += kSamplePeriod) {
      if (sample_time > end + 6.0) break;
      ImuSample sample = imu_sample(drive.pose, sample_time, noise(0.001));
      for (double& force : sample.linear_acceleration) force += 0.02 * normal(generator);
      const std::optional<ImuSample> sent = drive.fault(sample);
      if (!sent) continue;
      ImuSample in_lidar_time = *sent;
      in_lidar_time.stamp = sent->stamp - monitor.time_shift();
      if (buffer.add(in_lidar_time, Eigen::Quaterniond::Identity())) monitor.add(*sent);
    }
    SE3 registered = drive.pose(end);
    registered.translation += noise(0.005);
    registered.rotation = registered.rotation * so3_exp(noise(0.01 * nilio::kRadiansPerDegree));
    RegisteredMotion motion;
    motion.from = Time::from_seconds(end - kScanPeriod);
    motion.to = Time::from_seconds(end);
    motion.T_odom_from = previous;
    motion.T_odom_to = registered;
    const Duration shift = monitor.time_shift();
    monitor.observe(buffer, Vector3::Zero(), motion);
    buffer.move_stamps(shift - monitor.time_shift());
    previous = registered;
  }
  return monitor.health();
}

ImuHealth watch(const ImuFault& fault) {
  Drive drive;
  drive.fault = fault;
  return watch(drive);
}

ImuFault mounted_rotated(const Vector3& rotation_vector) {
  const Eigen::Quaterniond to_imu = so3_exp(rotation_vector).conjugate();
  return changed([to_imu](ImuSample& sample) {
    for (auto* values : {&sample.angular_velocity, &sample.linear_acceleration}) {
      const Vector3 turned = to_imu * Vector3((*values)[0], (*values)[1], (*values)[2]);
      *values = {turned.x(), turned.y(), turned.z()};
    }
  });
}

std::size_t alarms(const ImuHealth& health) {
  return static_cast<std::size_t>(
      std::count_if(health.rows.begin(), health.rows.end(),
                    [](const ImuDiagnosis& row) { return row.worst_state >= ImuCheckState::kWarn; }));
}

}  // namespace

TEST_CASE("a sound IMU is accepted, every motion check has a value, and none warns", "[imu_monitor]") {
  const ImuHealth health = watch(Drive{});
  CHECK(health.trusted);
  CHECK(health.demotions == 0);
  CHECK(alarms(health) == 0);
  for (const ImuDiagnosis& row : health.rows) CHECK(row.state == ImuCheckState::kOk);
  CHECK(health[ImuCheck::kGyroScale].value == Approx(1.0).margin(0.01));
  CHECK(health[ImuCheck::kGyroMounting].value < 0.5);
  CHECK(health[ImuCheck::kAccelMounting].value < 1.0);
  CHECK(std::abs(health[ImuCheck::kTimeOffset].value) < 1.0);
  CHECK(health[ImuCheck::kGravityMagnitude].value == Approx(9.81).margin(0.1));
}

TEST_CASE("on a straight road mounting, scale and time offset stay unknown, and the gyro is not accepted",
          "[imu_monitor]") {
  Drive drive;
  drive.pose = [](double t) { return SE3{Eigen::Quaterniond::Identity(), Vector3(10.0 * t, 0.0, 0.0)}; };
  const ImuHealth health = watch(drive);
  for (const ImuCheck check :
       {ImuCheck::kGyroAxes, ImuCheck::kGyroMounting, ImuCheck::kGyroScale, ImuCheck::kTimeOffset}) {
    CHECK(health[check].state == ImuCheckState::kUnknown);
  }
  CHECK_FALSE(health.trusted);
  CHECK(health.demotions == 0);
}

TEST_CASE("swapped axes and flipped signs are named by the axes they are measured on", "[imu_monitor]") {
  const ImuHealth swapped = watch(changed([](ImuSample& s) {
    std::swap(s.angular_velocity[0], s.angular_velocity[2]);
    std::swap(s.linear_acceleration[0], s.linear_acceleration[2]);
  }));
  CHECK(swapped[ImuCheck::kGyroAxes].value == Approx(90.0).margin(3.0));
  CHECK(swapped.measured_on[2] == 1);
  CHECK(swapped.reason == ImuCheck::kGyroAxes);
  CHECK(swapped[ImuCheck::kGravityDirection].state == ImuCheckState::kBad);

  const ImuHealth flipped = watch(changed([](ImuSample& s) { s.angular_velocity[2] *= -1.0; }));
  CHECK(flipped[ImuCheck::kGyroAxes].value == Approx(180.0).margin(3.0));
  CHECK(flipped.measured_on[2] == -3);
  CHECK_FALSE(flipped.trusted);
  CHECK(hint_for(ImuCheck::kGyroAxes, flipped).find("+z of base_link is measured on -z") !=
        std::string::npos);
  CHECK(flipped[ImuCheck::kGravityDirection].state == ImuCheckState::kOk);
}

TEST_CASE("wrong units are identified by the scale: degrees for radians, and g for m/s^2", "[imu_monitor]") {
  const ImuHealth degrees = watch(changed([](ImuSample& s) {
    for (double& rate : s.angular_velocity) rate /= nilio::kRadiansPerDegree;
  }));
  CHECK(degrees[ImuCheck::kGyroScale].value == Approx(57.3).margin(0.5));
  CHECK(degrees.reason == ImuCheck::kGyroScale);
  CHECK(hint_for(ImuCheck::kGyroScale, degrees).find("deg/s") != std::string::npos);

  const ImuHealth in_g = watch(changed([](ImuSample& s) {
    for (double& force : s.linear_acceleration) force /= 9.80665;
  }));
  CHECK(in_g[ImuCheck::kGravityMagnitude].value == Approx(1.0).margin(0.01));
  CHECK(in_g[ImuCheck::kGravityMagnitude].state == ImuCheckState::kBad);
  CHECK(hint_for(ImuCheck::kGravityMagnitude, in_g).find("9.80665") != std::string::npos);
  // The gyro is unaffected.
  CHECK(in_g.trusted);
}

TEST_CASE("a mounting rotated by ten degrees is measured about each axis", "[imu_monitor]") {
  for (const Vector3& axis : {Vector3(1.0, 0.0, 0.0), Vector3(0.0, 1.0, 0.0), Vector3(0.0, 0.0, 1.0)}) {
    const ImuHealth health = watch(mounted_rotated(10.0 * nilio::kRadiansPerDegree * axis));
    CHECK(health[ImuCheck::kAccelMounting].value == Approx(10.0).margin(1.0));
    CHECK(health[ImuCheck::kAccelMounting].state == ImuCheckState::kBad);
    // A turn about z does not show where z is measured when the IMU itself is turned about z.
    if (axis.z() == 0.0) CHECK(health[ImuCheck::kGyroMounting].value == Approx(10.0).margin(1.0));
  }
}

TEST_CASE("a time offset is estimated within 3 ms with its sign, and applied to the stamps",
          "[imu_monitor]") {
  for (const double offset_ms : {-100.0, -20.0, 5.0, 20.0, 100.0}) {
    const ImuHealth health =
        watch(changed([&](ImuSample& s) { s.stamp = s.stamp + Duration::from_milliseconds(offset_ms); }));
    const ImuDiagnosis& row = health[ImuCheck::kTimeOffset];
    CHECK(row.value == Approx(offset_ms).margin(3.0));
    CHECK((row.state >= ImuCheckState::kWarn) == (std::abs(offset_ms) > 10.0));
    CHECK(health.time_shift_ms == Approx(offset_ms).margin(3.0));
    CHECK(health.trusted);
    CHECK(health.time_offset_sigma_ms < 1.5);
  }
}

TEST_CASE("an offset beyond the largest shift is reported as that shift, not as none", "[imu_monitor]") {
  Drive drive;
  drive.seconds = 60.0;
  drive.fault = changed([](ImuSample& s) { s.stamp = s.stamp + Duration::from_milliseconds(200.0); });
  const ImuHealth health = watch(drive);
  CHECK_FALSE(health.trusted);
  CHECK(health[ImuCheck::kTimeOffset].state == ImuCheckState::kBad);
  CHECK(health[ImuCheck::kTimeOffset].value == Approx(150.0));
}

TEST_CASE("a bias is estimated on straight pieces and not mistaken for scale", "[imu_monitor]") {
  const ImuHealth health = watch(changed([](ImuSample& s) {
    for (double& rate : s.angular_velocity) rate += 2.0 * nilio::kRadiansPerDegree;
  }));
  CHECK(health[ImuCheck::kGyroBias].value == Approx(2.0).margin(0.2));
  CHECK(health[ImuCheck::kGyroBias].state == ImuCheckState::kWarn);
  CHECK(health[ImuCheck::kGyroScale].value == Approx(1.0).margin(0.01));
}

TEST_CASE(
    "clipping is distinguished from a fast turn, with its full scale, and clipped scans do not use the gyro",
    "[imu_monitor]") {
  const double full_scale = 15.0 * nilio::kRadiansPerDegree;
  const ImuHealth health = watch(changed([&](ImuSample& s) {
    for (double& rate : s.angular_velocity) rate = std::clamp(rate, -full_scale, full_scale);
  }));
  CHECK(health[ImuCheck::kGyroSaturation].value == Approx(15.0).margin(0.01));
  CHECK(health[ImuCheck::kGyroSaturation].state == ImuCheckState::kBad);
  CHECK(health[ImuCheck::kAccelSaturation].state == ImuCheckState::kOk);
  CHECK(health[ImuCheck::kGyroScale].worst_state <= ImuCheckState::kOk);
}

TEST_CASE("clipped and repeated samples are not used from the first tenth of a second on", "[imu_monitor]") {
  ImuMonitor monitor({});
  ImuBuffer buffer(1024);
  const auto feed = [&](int i, double rate) {
    const ImuSample sample{Time::from_seconds(0.005 * i), {0.0, 0.0, rate}, {0.0, 0.0, 9.81}};
    REQUIRE(buffer.add(sample, Eigen::Quaterniond::Identity()));
    monitor.add(sample);
  };
  const auto pose_at = [](double t) {
    return SE3{Eigen::Quaterniond(Eigen::AngleAxisd(-0.1 * std::cos(3.0 * t), Vector3::UnitZ())),
               Vector3::Zero()};
  };
  for (int i = 0; i < 400; ++i) {
    feed(i, 0.3 * std::sin(3.0 * 0.005 * i));
    if (i % 20 != 0 || i < 40) continue;
    const double from = 0.005 * (i - 20);
    const double to = 0.005 * i;
    monitor.observe(buffer, Vector3::Zero(),
                    {Time::from_seconds(from), Time::from_seconds(to), pose_at(from), pose_at(to)});
  }
  REQUIRE(monitor.usable(Time::from_seconds(1.9), Time::from_seconds(1.99)));
  for (int i = 400; i < 425; ++i) feed(i, 0.35);
  CHECK_FALSE(monitor.usable(Time::from_seconds(2.02), Time::from_seconds(2.12)));
}

TEST_CASE("stuck values, silence and lost samples are reported with their size", "[imu_monitor]") {
  std::optional<ImuSample> frozen;
  const ImuHealth stuck = watch([&](const ImuSample& sample) {
    if (sample.stamp < Time::from_seconds(35.0)) return std::optional(sample);
    if (!frozen) frozen = sample;
    ImuSample repeated = *frozen;
    repeated.stamp = sample.stamp;
    return std::optional(repeated);
  });
  CHECK(stuck[ImuCheck::kGyroStuck].value == Approx(5.0).margin(0.2));
  CHECK(stuck[ImuCheck::kAccelStuck].state == ImuCheckState::kBad);
  CHECK(stuck.reason == ImuCheck::kGyroStuck);

  const ImuHealth silent = watch([](const ImuSample& sample) {
    const bool lost = sample.stamp > Time::from_seconds(30.0) && sample.stamp < Time::from_seconds(35.0);
    return lost ? std::nullopt : std::optional(sample);
  });
  CHECK(silent[ImuCheck::kSampleGap].value == Approx(5.0).margin(0.05));
  CHECK(silent[ImuCheck::kSampleGap].state == ImuCheckState::kBad);
  CHECK(silent[ImuCheck::kSampleLoss].state == ImuCheckState::kOk);
  CHECK(silent.trusted);

  std::mt19937 generator(3);
  const ImuHealth lossy = watch(
      [&](const ImuSample& sample) { return generator() % 10 < 3 ? std::nullopt : std::optional(sample); });
  CHECK(lossy[ImuCheck::kSampleLoss].value == Approx(30.0).margin(5.0));
  CHECK(lossy[ImuCheck::kSampleLoss].state == ImuCheckState::kBad);
}

TEST_CASE("noise and vibration are measured as their root mean square", "[imu_monitor]") {
  std::mt19937 generator(3);
  std::normal_distribution<double> normal;
  const ImuHealth health = watch(changed([&](ImuSample& s) {
    for (double& rate : s.angular_velocity) rate += 3.0 * nilio::kRadiansPerDegree * normal(generator);
    for (double& force : s.linear_acceleration) force += 5.0 * normal(generator);
  }));
  CHECK(health[ImuCheck::kGyroNoise].value == Approx(3.0).margin(0.2));
  CHECK(health[ImuCheck::kGyroNoise].state == ImuCheckState::kWarn);
  CHECK(health[ImuCheck::kAccelVibration].value == Approx(5.0).margin(0.3));
  CHECK(health[ImuCheck::kAccelVibration].state == ImuCheckState::kWarn);
}

TEST_CASE("a rejected gyro is accepted again after agreement in turns, not on a straight road",
          "[imu_monitor]") {
  // Wrong for 5 s, then sound; the memory of the wrong ones has faded at the end.
  const ImuFault wrong_at_first = changed([](ImuSample& s) {
    if (s.stamp > Time::from_seconds(3.0) && s.stamp < Time::from_seconds(8.0))
      s.angular_velocity[1] += 6.0 * s.angular_velocity[2];
  });
  Drive turning;
  turning.fault = wrong_at_first;
  turning.seconds = 7.9;
  CHECK_FALSE(watch(turning).trusted);
  turning.seconds = 300.0;
  const ImuHealth later = watch(turning);
  CHECK(later.trusted);
  CHECK(later.demotions == 1);

  Drive straightening = turning;
  straightening.seconds = 40.0;
  straightening.pose = [](double t) {
    const SE3 end = winding_road(8.0);
    if (t < 8.0) return winding_road(t);
    return SE3{end.rotation, end.translation + (t - 8.0) * Vector3(8.0, 0.0, 0.0)};
  };
  CHECK_FALSE(watch(straightening).trusted);
}

TEST_CASE("every check has a name and a unit, and hints appear only with warnings", "[imu_monitor]") {
  for (std::size_t i = 0; i < kImuChecks; ++i) {
    const auto check = static_cast<ImuCheck>(i);
    CHECK(std::string(name_of(check)).size() > 3);
    CHECK_FALSE(std::string(unit_of(check)).empty());
    CHECK(hint_for(check, ImuHealth{}).empty());
    ImuHealth bad;
    bad.rows[i].state = ImuCheckState::kBad;
    CHECK(hint_for(check, bad).size() > 10);
  }
}
