#include "daemon/config/schema.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/tools/run_command.hpp"

#include <string>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using Catch::Matchers::Contains;
using tests::TemporaryFolder;

namespace {

constexpr const char* kPlanted = " --lidar-extrinsic 0 0 1.9 3 -4 25";

void simulate(const std::string& arguments) {
  const auto simulated =
      tests::capture_command(tools::add_simulate_command, "simulate --realism ideal " + arguments);
  INFO(simulated.errors);
  REQUIRE(simulated.status == 0);
}

tests::CommandResult init(const std::string& arguments) {
  return tests::capture_command(tools::add_init_command, "init " + arguments);
}

/// The planted mounting, within the tolerance of the requirement.
void check_mounting(const std::string& path) {
  daemon::Config config;
  REQUIRE(daemon::apply_file(config, path).ok());
  const auto& extrinsic = config.lidar.extrinsic;
  CHECK(extrinsic.translation.at(2) == Approx(1.9).margin(0.03));
  CHECK(extrinsic.rotation_rpy_deg.at(0) == Approx(3.0).margin(0.3));
  CHECK(extrinsic.rotation_rpy_deg.at(1) == Approx(-4.0).margin(0.3));
  CHECK(extrinsic.rotation_rpy_deg.at(2) == Approx(25.0).margin(0.3));
}

}  // namespace

TEST_CASE("init finds the mounting of the LiDAR and the IMU of a drive", "[init][drives]") {
  const std::string sensor = GENERATE("vlp16", "hdl64e");
  const int seed = GENERATE_COPY(range(1, tests::is_full_run() ? 3 : 2));
  INFO(sensor << ", seed " << seed);
  const TemporaryFolder folder;
  const std::string config = folder.file("vehicle.yaml");
  simulate(folder.text() + " --sensor " + sensor + " --seed " + std::to_string(seed) + " --duration 20" +
           kPlanted);
  const auto result = init(folder.text() + " --output " + config);
  INFO(result.errors << result.output);
  REQUIRE(result.status == 0);
  check_mounting(config);
  CHECK_THAT(result.output, Contains("yaw from ") && Contains("m of straight driving") &&
                                Contains("made by nilio init") && Contains("preset: \"xsens_mti\"") &&
                                Contains("interface: \"can0\""));
  const auto again = init(folder.text() + " --output " + config);
  CHECK(again.status == 1);
  CHECK_THAT(again.errors, Contains("exists") && Contains("--force"));
}

TEST_CASE("init says that yaw was not observed at standstill", "[init][drives]") {
  const TemporaryFolder folder;
  const std::string config = folder.file("vehicle.yaml");
  simulate(folder.text() + " --scene standstill --duration 4 --imu none" + kPlanted);
  const auto result = init(folder.text() + " --output " + config);
  INFO(result.errors << result.output);
  REQUIRE(result.status == 0);
  CHECK_THAT(result.output, Contains("yaw was not observed: 0 m of straight driving"));
  daemon::Config found;
  REQUIRE(daemon::apply_file(found, config).ok());
  CHECK(found.lidar.extrinsic.rotation_rpy_deg.at(2) == 0.0);
  // From one place, higher ground beside the road counts, too.
  CHECK(found.lidar.extrinsic.translation.at(2) == Approx(1.9).margin(0.15));
}
