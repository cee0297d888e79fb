#include "tools/simulate/faults/imu_faults.hpp"

#include "tests/support/tools/run_command.hpp"
#include "tests/support/tools/simulate_support.hpp"
#include "tools/commands/commands.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools::simulate;

namespace {

const core::Time kBegin{1'000'000'000};
constexpr double kDuration = 10.0;
const core::ImuSample kSample{kBegin, {0.1, 0.2, 0.3}, {1.0, 2.0, 9.0}};

ImuFaults make(const std::string& fault) {
  const core::Result<ImuFaultConfig> config = parse_imu_faults({fault});
  REQUIRE(config.ok());
  return {*config, kBegin, kDuration, 1};
}

core::ImuSample at(double seconds, double rate) {
  return {kBegin + core::Duration::from_seconds(seconds), {rate, rate, rate}, {0.0, 0.0, 9.81}};
}

std::string problem_with(const std::string& fault) {
  const core::Result<ImuFaultConfig> config = parse_imu_faults({fault});
  return config ? std::string() : config.error().message;
}

/// "nilio simulate <arguments>".
tests::CommandResult run_simulate(const std::string& arguments) {
  return tests::capture_command(tools::add_simulate_command, "simulate " + arguments);
}

}  // namespace

TEST_CASE("without faults samples are unchanged and no frame is lost", "[imu_faults]") {
  ImuFaults faults({}, kBegin, kDuration, 1);
  const auto sample = faults.apply(kSample);
  REQUIRE(sample);
  CHECK(sample->stamp == kSample.stamp);
  CHECK(sample->angular_velocity == kSample.angular_velocity);
  CHECK(sample->linear_acceleration == kSample.linear_acceleration);
  for (int i = 0; i < 100; ++i) CHECK_FALSE(faults.loses_frame());
}

TEST_CASE("axes are permuted as configured, for gyroscope and accelerometer", "[imu_faults]") {
  const auto sample = make("axes=-zyx").apply(kSample);
  REQUIRE(sample);
  CHECK(sample->angular_velocity == std::array{-0.3, 0.2, 0.1});
  CHECK(sample->linear_acceleration == std::array{-9.0, 2.0, 1.0});
}

TEST_CASE("units, bias, range, mounting and clock change values and stamps as configured", "[imu_faults]") {
  CHECK(make("gyro_degrees").apply(kSample)->angular_velocity[0] == Approx(5.7296).margin(1e-4));
  CHECK(make("accel_g").apply(kSample)->linear_acceleration[2] == Approx(9.0 / 9.80665));
  CHECK(make("gyro_bias=2").apply(kSample)->angular_velocity[0] == Approx(0.1 + 0.034907).margin(1e-5));
  CHECK(make("gyro_range=10").apply(kSample)->angular_velocity[2] == Approx(0.174533).margin(1e-5));
  CHECK(make("time_offset=-20").apply(kSample)->stamp == kBegin - core::Duration{20'000'000});
  // x of an IMU turned left by 90 degrees points along the former y.
  const auto turned = make("mounting_yaw=90").apply(kSample);
  CHECK(turned->angular_velocity[0] == Approx(0.2));
  CHECK(turned->angular_velocity[1] == Approx(-0.1));
}

TEST_CASE("dropouts and stuck values begin half way through the drive", "[imu_faults]") {
  ImuFaults dropout = make("dropout=2");
  CHECK(dropout.apply(at(4.99, 0.1)));
  CHECK_FALSE(dropout.apply(at(5.0, 0.1)));
  CHECK_FALSE(dropout.apply(at(6.99, 0.1)));
  CHECK(dropout.apply(at(7.0, 0.1)));

  ImuFaults stuck = make("stuck");
  CHECK(stuck.apply(at(4.0, 0.1))->angular_velocity[0] == 0.1);
  CHECK(stuck.apply(at(5.0, 0.2))->angular_velocity[0] == 0.2);
  CHECK(stuck.apply(at(6.0, 0.3))->angular_velocity[0] == 0.2);
  CHECK(stuck.apply(at(6.0, 0.3))->stamp == at(6.0, 0.0).stamp);
}

TEST_CASE("the configured share of frames is lost", "[imu_faults]") {
  ImuFaults faults = make("frames_lost=30");
  int lost = 0;
  for (int i = 0; i < 10000; ++i) lost += faults.loses_frame() ? 1 : 0;
  CHECK(lost == Approx(3000).margin(150));
}

TEST_CASE("a misspelt fault or a value out of range is rejected with the list of faults or the range",
          "[imu_faults]") {
  CHECK(problem_with("gyro_biass=2").find("gyro_bias=VALUE") != std::string::npos);
  CHECK(problem_with("gyro_bias").find("deg/s between -100 and 100") != std::string::npos);
  CHECK(problem_with("gyro_bias=nan").find("between") != std::string::npos);
  CHECK(problem_with("gyro_bias=2x").find("between") != std::string::npos);
  CHECK(problem_with("frames_lost=101").find("between 0 and 100") != std::string::npos);
  CHECK(problem_with("axes=xyy").find("three axes") != std::string::npos);
  CHECK(problem_with("axes=xyzx").find("three axes") != std::string::npos);
  CHECK(problem_with("stuck=1").find("no value") != std::string::npos);
}

TEST_CASE("nilio simulate applies several faults, and rejects them without an IMU or when misspelt",
          "[imu_faults]") {
  const tests::TemporaryFolder folder;
  const std::string options = folder.path().string() + " --duration 1 --moving-start --moving-cars 0";
  REQUIRE(run_simulate(options).status == 0);
  const std::string sound = tests::read_file(folder.path() / "imu.candump.log");
  REQUIRE(run_simulate(options + " --imu-fault dropout=0.5 --imu-fault gyro_bias=2").status == 0);
  const std::string faulty = tests::read_file(folder.path() / "imu.candump.log");
  CHECK(std::count(faulty.begin(), faulty.end(), '\n') <
        std::count(sound.begin(), sound.end(), '\n') * 3 / 5);
  CHECK(faulty.substr(0, 60) != sound.substr(0, 60));
  const tests::CommandResult without = run_simulate(options + " --imu none --imu-fault stuck");
  CHECK(without.status == 2);
  CHECK(without.errors.find("--imu none") != std::string::npos);
  const tests::CommandResult misspelt = run_simulate(options + " --imu-fault stack");
  CHECK(misspelt.status == 2);
  CHECK(misspelt.errors.find("stuck") != std::string::npos);
}
