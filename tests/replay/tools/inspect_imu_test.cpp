#include "daemon/config/schema.hpp"
#include "tests/support/room_drive.hpp"
#include "tests/support/tools/inspect_support.hpp"
#include "tools/simulate/faults/imu_faults.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

using namespace nilio;
using namespace nilio::tools;
using Catch::Matchers::Contains;
using nlohmann::json;
using tests::TemporaryFolder;

namespace {

constexpr double kSeconds = 16.0;

/// Bends to both sides at 6 m/s after a stationary second, with occasional braking.
core::SE3 winding(double t) {
  const double s = std::max(0.0, t - 1.0);
  const double along = (s < 2.0 ? 1.5 * s * s : 6.0 * s - 6.0) +
                       (s < 2.0 ? 0.0 : 1.2 * std::pow(std::sin(0.5 * (s - 2.0)), 2.0));
  const double yaw = 0.35 * (1.0 - std::cos(along / 6.0)) - 0.2 * std::sin(along / 9.0);
  return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw, core::Vector3::UnitZ())),
          core::Vector3(along, 2.5 * std::sin(along / 11.0), 0.0)};
}

/// The drive's LiDAR packets, cast once for all faults.
const std::filesystem::path& drive_folder() {
  static const TemporaryFolder folder;
  static const bool written = [] {
    tests::write_room_drive(folder.path(), winding, kSeconds, false);
    return true;
  }();
  static_cast<void>(written);
  return folder.path();
}

void write_imu_log(const std::vector<std::string>& faults) {
  const auto config = simulate::parse_imu_faults(faults);
  REQUIRE(config.ok());
  const drivers::ImuPreset preset = drivers::imu_preset("xsens_mti").value();
  simulate::ImuFaults planted(*config, core::Time{tests::kDriveStartNs}, kSeconds, 1);
  std::ofstream log(drive_folder() / "imu.log");
  for (int i = 0; i * 0.005 < kSeconds + 0.5; ++i) {
    core::ImuSample sample = tests::imu_sample(winding, i * 0.005, core::Vector3(0.002, 0.001, 0.0035));
    sample.stamp = core::Time{tests::kDriveStartNs + i * 5'000'000LL};
    const auto faulty = planted.apply(sample);
    if (!faulty) continue;
    for (const drivers::CanFrame& frame : drivers::encode_imu_sample(*faulty, preset))
      log << drivers::format_candump_line(frame, "can0") << '\n';
  }
}

/// Result of the check as JSON, with a configuration if there is one.
json check_imu(const std::string& arguments) {
  const auto result = tests::run_inspect(drive_folder().string() + " --json - " + arguments);
  CHECK(result.status == 0);
  CHECK(result.errors.empty());
  const json findings = json::parse(result.output);
  INFO(findings["imu_against_lidar_problem"]);
  REQUIRE(findings["imu_against_lidar"].is_object());
  return findings["imu_against_lidar"];
}

std::vector<std::string> bad_checks(const json& drive) {
  std::vector<std::string> names;
  for (const auto& [name, row] : drive["health"]["checks"].items()) {
    // An ideal stationary IMU repeats its values.
    if (row["state"] == "bad" && name != "gyro_stuck" && name != "accel_stuck") names.push_back(name);
  }
  return names;
}

}  // namespace

TEST_CASE("an IMU that agrees with the LiDAR is reported as such, without a correction",
          "[inspect_imu][drives]") {
  write_imu_log({});
  const json drive = check_imu("");
  CHECK(bad_checks(drive).empty());
  CHECK(drive["correction"].empty());
  CHECK(drive["poses"].get<int>() >= 158);
  CHECK(drive["health"]["trusted"] == true);
  CHECK(drive["cut_short"] == false);
  CHECK(std::abs(drive["time_offset_ms"].get<double>()) < 3.0);
  const auto report = tests::run_inspect(drive_folder().string());
  CHECK_THAT(report.output, Contains("IMU against LiDAR") && Contains("gyro_agreement") &&
                                Contains("correction       none"));
}

TEST_CASE("the configuration written for a faulty IMU makes it agree", "[inspect_imu][drives]") {
  const TemporaryFolder folder;
  const std::string written = (folder.path() / "corrected.yaml").string();
  struct Case {
    std::vector<std::string> faults;
    const char* key;
    double value;
    double tolerance;
    bool keeps_gyro_out;
  };
  const std::vector<Case> cases = {
      {{"axes=xy-z"}, "imu.angular_velocity_z.scale", -1.0, 1e-9, true},
      {{"gyro_degrees", "time_offset=40"}, "imu.angular_velocity_y.scale", 0.01745329, 1e-6, true},
      {{"time_offset=-100", "accel_g"}, "imu.time_offset_ms", -100.0, 3.0, false},
  };
  for (const Case& c : cases) {
    INFO(c.faults.front());
    write_imu_log(c.faults);
    const json before = check_imu("--write-config " + written);
    REQUIRE(before["correction"].contains(c.key));
    CHECK(before["correction"][c.key].get<double>() == Approx(c.value).margin(c.tolerance));
    const json after = check_imu("--config " + written);
    INFO("before " << before["correction"] << ", after " << after["correction"]);
    CHECK(bad_checks(after).empty());
    CHECK(after["correction"].empty());
    CHECK(after["health"]["trusted"] == true);
    if (c.keeps_gyro_out) CHECK(before["with_gyro_corrected"].get<int>() > before["with_gyro"].get<int>());
    // All but the scans before the first turn has proven it.
    CHECK(before["with_gyro_corrected"].get<double>() > 0.8 * before["poses"].get<double>());
  }
}

TEST_CASE("a mounting that is not configured is found, and the rest of the configuration is kept",
          "[inspect_imu][drives]") {
  const TemporaryFolder folder;
  const std::string given = (folder.path() / "given.yaml").string();
  const std::string written = (folder.path() / "corrected.yaml").string();
  std::ofstream(given)
      << "odometry: {threads: 1, imu_wait_ms: 7}\nimu: {extrinsic: {translation: [0, 0, 0]}}\n";
  write_imu_log({"mounting_yaw=10"});
  const json before = check_imu("--config " + given + " --write-config " + written);
  const auto rpy = before["correction"]["imu.extrinsic.rotation_rpy_deg"].get<std::vector<double>>();
  CHECK(rpy.at(2) == Approx(10.0).margin(1.5));
  CHECK(std::hypot(rpy.at(0), rpy.at(1)) < 1.5);
  daemon::Config config;
  REQUIRE(daemon::apply_file(config, written).ok());
  CHECK(config.odometry.imu_wait_ms == 7.0);
  CHECK(config.imu.extrinsic.rotation_rpy_deg == rpy);
}

TEST_CASE("the check covers the requested part of the recording", "[inspect_imu][drives]") {
  write_imu_log({});
  const json drive = check_imu("--imu-seconds 3");
  CHECK(drive["cut_short"] == true);
  CHECK(drive["seconds"].get<double>() == Approx(2.9).margin(0.2));
  CHECK(check_imu("--imu-seconds 3") == drive);
  const auto without = tests::run_inspect(drive_folder().string() + " --imu-seconds 0 --json -");
  CHECK(json::parse(without.output)["imu_against_lidar"].is_null());
}

TEST_CASE("an IMU that is not in the log skips the check with a reason", "[inspect_imu][drives]") {
  write_imu_log({});
  const TemporaryFolder folder;
  const std::string other = (folder.path() / "other.yaml").string();
  std::ofstream(other) << "imu: {preset: oxts_rt3003}\n";
  const auto result = tests::run_inspect(drive_folder().string() + " --imu-seconds 3 --config " + other);
  CHECK(result.status == 0);
  CHECK_THAT(result.output,
             Contains("not checked") && Contains("no sample of the configured IMU (oxts_rt3003)"));
}
