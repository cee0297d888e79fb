#include "core/src/imu_monitor/gyro_consistency.hpp"

#include "nilio/core/units.hpp"

#include <cmath>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;
using nilio::kRadiansPerDegree;

namespace {

constexpr double kPeriodS = 0.1;

/// A gyro that measures (1 + error) times the yaw rate of a winding road, up to 30 deg/s.
GyroConsistency driven(double error, int scans) {
  GyroConsistency result;
  for (int i = 0; i < scans; ++i) {
    const Vector3 rate = 30.0 * kRadiansPerDegree * std::sin(0.1 * i) * Vector3::UnitZ();
    result.add((1.0 + error) * rate, rate, kPeriodS);
  }
  return result;
}

}  // namespace

TEST_CASE("turns show the error of a gyro's scale", "[gyro_consistency]") {
  CHECK(GyroConsistency().scale_deviation() == Approx(0.3));
  CHECK(driven(0.0, 100).scale_deviation() == Approx(0.01));
  CHECK(driven(0.05, 100).scale_deviation() == Approx(0.05).margin(0.005));
  CHECK(driven(0.15, 100).scale_deviation() == Approx(0.15).margin(0.015));
  CHECK(driven(2.0, 100).scale_deviation() == Approx(0.3));
}

TEST_CASE("a gyro that turns show to be right is accepted, one with a wrong axis or unit rejected",
          "[gyro_consistency]") {
  CHECK(driven(0.01, 100).accepted());
  for (const double error : {-2.0, -1.0, 0.7, 56.3}) {
    INFO(error);
    CHECK(driven(error, 100).rejected());
    CHECK_FALSE(driven(error, 100).accepted());
  }
}

TEST_CASE(
    "a steady bend, in which a constant rate is always right, does not reject a gyro with an error of scale",
    "[gyro_consistency]") {
  GyroConsistency consistency = driven(0.06, 16);
  const Vector3 rate = 26.0 * kRadiansPerDegree * Vector3::UnitZ();
  for (int i = 0; i < 100; ++i) consistency.add(1.06 * rate, rate, kPeriodS);
  CHECK_FALSE(consistency.rejected());
  // One that fails in the bend is.
  for (int i = 0; i < 20; ++i) consistency.add(0.5 * rate, rate, kPeriodS);
  CHECK(consistency.rejected());
}

TEST_CASE("registered rotations that are only noise seldom reject a sound gyro", "[gyro_consistency]") {
  int rejected = 0;
  for (unsigned seed = 1; seed <= 100; ++seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> noise(0.0, 1.5 * kRadiansPerDegree);
    GyroConsistency consistency;
    bool once = false;
    for (int i = 0; i < 200; ++i) {
      consistency.add(Vector3::Zero(), noise(random) * Vector3::UnitZ(), kPeriodS);
      once = once || consistency.rejected();
    }
    if (once) ++rejected;
  }
  CHECK(rejected <= 10);
}
