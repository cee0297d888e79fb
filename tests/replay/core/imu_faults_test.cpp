#include "nilio/core/odometry.hpp"
#include "nilio/core/odometry_runtime.hpp"
#include "nilio/core/units.hpp"

#include "tests/support/imu_fault.hpp"
#include "tests/support/synthetic_room.hpp"

#include <algorithm>
#include <functional>
#include <optional>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio::core;
using nilio::tests::changed;
using nilio::tests::imu_sample;
using nilio::tests::ImuFault;
using nilio::tests::Room;
using nilio::tests::scan_room;

namespace {

constexpr double kPeriod = 0.1;
constexpr int kScans = 130;
constexpr int kScansOfLongDrive = 330;

/// 6 m/s in bends of 20 deg/s to both sides, after a stationary second.
SE3 winding(double t) {
  const double s = std::max(0.0, t - 1.0);
  const double along = s < 2.0 ? 1.5 * s * s : 6.0 * s - 6.0;
  const double yaw = 0.35 * (1.0 - std::cos(along / 6.0)) - 0.2 * std::sin(along / 9.0);
  return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Vector3::UnitZ())),
          Vector3(along, 2.5 * std::sin(along / 11.0), 0.0)};
}

const std::vector<Scan>& scans() {
  static const std::vector<Scan> all = [] {
    std::vector<Scan> result;
    for (int i = 0; i < kScansOfLongDrive; ++i)
      result.push_back(scan_room(Room::with_pillars(), winding, i * kPeriod, static_cast<std::uint64_t>(i)));
    return result;
  }();
  return all;
}

struct Run {
  std::vector<OdometryResult> results;
  ImuHealth health;
  double end_error_m = 0.0;
  double worst_step_m = 0.0;
  double worst_step_deg = 0.0;
  int with_imu = 0;
};

/// Drives through the hall with a faulty IMU; without a fault function there is no IMU.
Run drive(const ImuFault& fault, int threads = 1, int count = kScans) {
  OdometryConfig config;
  config.threads = threads;
  Odometry odometry(config);
  const OdometryRuntime runtime(odometry);
  Run run;
  int next = -40;
  for (int i = 0; i < count; ++i) {
    const Scan& scan = scans()[static_cast<std::size_t>(i)];
    while (fault && next < 200 * count && (!runtime.latest_imu() || *runtime.latest_imu() < scan.end)) {
      if (const auto sample = fault(imu_sample(winding, 0.005 * next++, Vector3(0.002, -0.001, 0.003))))
        odometry.add_imu(*sample);
    }
    run.results.push_back(odometry.register_scan(scan));
    run.with_imu += run.results.back().imu_used ? 1 : 0;
    if (i == 0) continue;
    const SE3 truth = winding(i * kPeriod).inverse() * winding((i + 1) * kPeriod);
    const SE3 step =
        run.results[run.results.size() - 2].T_odom_base.inverse() * run.results.back().T_odom_base;
    const SE3 error = truth.inverse() * step;
    run.worst_step_m = std::max(run.worst_step_m, error.translation.norm());
    run.worst_step_deg =
        std::max(run.worst_step_deg, so3_log(error.rotation).norm() / nilio::kRadiansPerDegree);
  }
  const SE3 truth = winding(kPeriod).inverse() * winding(count * kPeriod);
  const SE3 whole = run.results.front().T_odom_base.inverse() * run.results.back().T_odom_base;
  run.end_error_m = (truth.translation - whole.translation).norm();
  run.health = odometry.imu_health();
  return run;
}

struct NamedFault {
  const char* name;
  ImuCheck check;
  double value;
  double tolerance;
  ImuFault fault;
};

std::vector<NamedFault> disqualifying_faults() {
  return {
      {"axes swapped", ImuCheck::kGyroAxes, 90.0, 3.0,
       changed([](ImuSample& s) { std::swap(s.angular_velocity[0], s.angular_velocity[2]); })},
      {"a sign flipped", ImuCheck::kGyroAxes, 180.0, 3.0,
       changed([](ImuSample& s) { s.angular_velocity[2] *= -1.0; })},
      {"all signs flipped", ImuCheck::kGyroAxes, 180.0, 3.0, changed([](ImuSample& s) {
         for (double& rate : s.angular_velocity) rate *= -1.0;
         for (double& force : s.linear_acceleration) force *= -1.0;
       })},
      {"degrees for radians", ImuCheck::kGyroScale, 57.3, 1.5, changed([](ImuSample& s) {
         for (double& rate : s.angular_velocity) rate /= nilio::kRadiansPerDegree;
       })},
  };
}

}  // namespace

TEST_CASE("a sound IMU is used from its first bend on, without a warning", "[imu_faults]") {
  const Run run = drive([](const ImuSample& sample) { return std::optional(sample); });
  CHECK(run.with_imu > kScans - 40);
  CHECK(run.health.demotions == 0);
  for (std::size_t i = 0; i < kImuChecks; ++i) {
    const auto check = static_cast<ImuCheck>(i);
    // An ideal IMU at rest does repeat its values.
    if (check == ImuCheck::kGyroStuck || check == ImuCheck::kAccelStuck) continue;
    INFO(name_of(check));
    CHECK(run.health.rows[i].worst_state <= ImuCheckState::kOk);
  }
}

TEST_CASE("a wrong IMU is reported, not used and harmless", "[imu_faults][drives]") {
  const Run without = drive(nullptr);
  for (const NamedFault& fault : disqualifying_faults()) {
    INFO(fault.name);
    const Run run = drive(fault.fault);
    CHECK(run.health[fault.check].state == ImuCheckState::kBad);
    CHECK(run.health[fault.check].value == Approx(fault.value).margin(fault.tolerance));
    CHECK_FALSE(run.health.trusted);
    CHECK_FALSE(run.results.back().imu_used);
    CHECK(run.end_error_m < without.end_error_m + 0.05);
    CHECK(run.worst_step_m < without.worst_step_m + 0.05);
    CHECK(run.worst_step_deg < without.worst_step_deg + 0.5);
  }
}

TEST_CASE("an IMU with a time offset is reported, corrected and used", "[imu_faults][drives]") {
  const Run without = drive(nullptr, 1, kScansOfLongDrive);
  for (const double offset_ms : {100.0, -100.0, 20.0, -20.0}) {
    INFO(offset_ms);
    const ImuFault shifted =
        changed([&](ImuSample& s) { s.stamp = s.stamp + Duration::from_milliseconds(offset_ms); });
    const Run run = drive(shifted, 1, kScansOfLongDrive);
    const ImuDiagnosis& row = run.health[ImuCheck::kTimeOffset];
    CHECK(row.value == Approx(offset_ms).margin(3.0));
    CHECK(row.state >= ImuCheckState::kWarn);
    CHECK(run.health.time_shift_ms == Approx(offset_ms).margin(4.0));
    CHECK(run.health.trusted);
    CHECK(run.results.back().imu_used);
    // 0.3 % of the way.
    CHECK(run.end_error_m < without.end_error_m + 0.003 * 6.0 * kPeriod * kScansOfLongDrive);
  }
}

TEST_CASE("with an IMU that fails half way the result is the same to the last bit for 1 and 2 threads",
          "[imu_faults]") {
  const ImuFault fails = changed([](ImuSample& s) {
    if (s.stamp > Time::from_seconds(6.0)) s.angular_velocity[2] *= -1.0;
  });
  const Run one = drive(fails, 1);
  const Run two = drive(fails, 2);
  CHECK(one.health.demotions > 0);
  for (std::size_t i = 0; i < one.results.size(); ++i) {
    CHECK(one.results[i].T_odom_base.translation == two.results[i].T_odom_base.translation);
    CHECK(one.results[i].T_odom_base.rotation.coeffs() == two.results[i].T_odom_base.rotation.coeffs());
    CHECK(one.results[i].imu_used == two.results[i].imu_used);
  }
  for (std::size_t i = 0; i < kImuChecks; ++i) CHECK(one.health.rows[i].value == two.health.rows[i].value);
}
