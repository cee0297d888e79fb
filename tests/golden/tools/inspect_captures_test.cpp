#include "daemon/config/schema.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/tools/inspect_support.hpp"
#include "tools/common/text.hpp"
#include "tools/inspect/config.hpp"
#include "tools/inspect/report/report.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::inspect;
using Catch::Matchers::Contains;
using drivers::ReturnMode;
using drivers::VelodyneModel;

namespace {

CaptureFindings inspect_one(const std::filesystem::path& path) {
  const RecordingFindings findings = inspect_recording({path.string()});
  CHECK(findings.problems.empty());
  CHECK(findings.usable());
  REQUIRE(findings.captures.size() == 1);
  return findings.captures.front();
}

}  // namespace

TEST_CASE("the report of every real capture agrees with its known facts", "[inspect_captures]") {
  struct Fact {
    const char* file;
    VelodyneModel model;
    ReturnMode mode;
    std::uint64_t data_packets;
    std::uint64_t position_packets;
    double revolutions_per_minute;
    std::uint64_t least_scans;
    core::ClockSource clock_source;
    bool early_firmware;
  };
  using enum core::ClockSource;
  const std::array<Fact, 8> facts{{
      {"hdl32e_highway_moving.pcap", VelodyneModel::kHdl32e, ReturnMode::kSingle, 876, 100, 703.4, 5,
       kNmeaOnly, false},
      {"hdl32e_monterey_stationary.pcap", VelodyneModel::kHdl32e, ReturnMode::kSingle, 2702, 299, 706.5, 17,
       kNmeaOnly, false},
      {"vlp16_preproduction_20hz_50rev.pcap", VelodyneModel::kVlp16, ReturnMode::kSingle, 1902, 367, 1200.0,
       49, kFreeRunning, true},
      {"vlp16_gps_stationary.pcap", VelodyneModel::kVlp16, ReturnMode::kSingle, 293, 57, 600.0, 3, kPpsLocked,
       false},
      {"vlp16_short.pcap", VelodyneModel::kVlp16, ReturnMode::kSingle, 84, 16, 600.0, 1, kFreeRunning, true},
      {"golden/vlp16.pcap", VelodyneModel::kVlp16, ReturnMode::kDual, 603, 0, 600.0, 3, kFreeRunning, false},
      {"golden/vlp32.pcap", VelodyneModel::kVlp32c, ReturnMode::kSingle, 379, 0, 600.0, 5, kFreeRunning,
       false},
      {"golden/vls128.pcap", VelodyneModel::kVls128, ReturnMode::kSingle, 2193, 0, 600.0, 3, kPtp, false},
  }};
  for (const Fact& fact : facts) {
    NILIO_REQUIRE_DATA(path, std::string("velodyne/") + fact.file);
    INFO(fact.file);
    const CaptureFindings capture = inspect_one(path);
    CHECK(capture.udp == fact.data_packets + fact.position_packets);
    CHECK(capture.malformed + capture.cut + capture.fragments + capture.further_streams == 0);
    CHECK(capture.streams.size() == (fact.position_packets > 0 ? 2 : 1));
    REQUIRE(capture.sensors.size() == 1);
    const SensorFindings& sensor = capture.sensors.front();
    CHECK(sensor.packets == fact.data_packets);
    CHECK(sensor.model == fact.model);
    CHECK(sensor.detection.model == fact.model);
    CHECK(sensor.status.mode == fact.mode);
    CHECK(sensor.hints.empty() != fact.early_firmware);
    CHECK(sensor.revolutions_per_minute.mean() == Approx(fact.revolutions_per_minute).epsilon(0.003));
    CHECK(sensor.revolutions_per_minute.maximum() < 1.01 * sensor.revolutions_per_minute.minimum());
    CHECK(sensor.complete_scans >= fact.least_scans);
    CHECK(sensor.partial_scans <= 2);
    CHECK(sensor.clock_source == fact.clock_source);
    CHECK(sensor.stats.points > 0);
    CHECK(sensor.range_m.minimum() > 0.1);
    CHECK(sensor.range_m.maximum() < 250.0);
    CHECK(sensor.stats.lost_packets + sensor.stats.duplicate_packets + sensor.stats.late_packets == 0);
    CHECK(sensor.stats.time_jumps + sensor.stats.host_clock_jumps + sensor.stats.firings_bad == 0);
    CHECK(sensor.gaps == 0);
    CHECK(sensor.telemetry.has_value() == (fact.position_packets > 0));
    if (sensor.telemetry) CHECK(sensor.telemetry->packets == fact.position_packets);
  }
}

TEST_CASE("a sensor with half its field of view switched off has a blind sector", "[inspect_captures]") {
  NILIO_REQUIRE_DATA(path, "velodyne/golden/vlp32.pcap");
  const CaptureFindings capture = inspect_one(path);
  const SensorFindings& sensor = capture.sensors.at(0);
  // From 270.17 to 90.95 degrees.
  CHECK(sensor.status.blind_sector_deg == Approx(179.2).margin(1.0));
  REQUIRE(sensor.field_of_view.has_value());
  CHECK(sensor.field_of_view->start_deg == 270);
  CHECK(sensor.field_of_view->end_deg == 91);
  CHECK_THAT(sensor_report(sensor), Contains("from 270 to 91 deg clockwise"));
}

TEST_CASE("the gyros and accelerometers of a stationary HDL-32E measure gravity and no rotation",
          "[inspect_captures]") {
  NILIO_REQUIRE_DATA(path, "velodyne/hdl32e_monterey_stationary.pcap");
  const CaptureFindings capture = inspect_one(path);
  const auto& telemetry = capture.sensors.at(0).telemetry;
  REQUIRE((telemetry && telemetry->motion));
  // X of boards 0 and 1 points up; the gyros have zero offsets of up to 30 deg/s.
  for (const std::size_t board : {0U, 1U})
    CHECK((*telemetry->motion)[board].acceleration_x_m_s2.mean() == Approx(9.4).margin(0.3));
  for (const BoardMotion& board : *telemetry->motion) {
    CHECK(board.gyro_deg_s.count() == 299);
    CHECK(board.gyro_deg_s.standard_deviation() < 3.0);
    CHECK(std::abs(board.gyro_deg_s.mean()) < 31.0);
    CHECK((board.temperature_degc.mean() > 30.0 && board.temperature_degc.mean() < 45.0));
  }
  CHECK(telemetry->nmea_valid == 299);
  REQUIRE((telemetry->fix && telemetry->fix->utc));
  CHECK(utc_text(*telemetry->fix->utc) == "2012-12-11 22:06:33.000");
}

TEST_CASE("a sensor locked to GPS is distinguished from the recorder's clock with an offset",
          "[inspect_captures]") {
  NILIO_REQUIRE_DATA(path, "velodyne/vlp16_gps_stationary.pcap");
  const CaptureFindings capture = inspect_one(path);
  const SensorFindings& sensor = capture.sensors.at(0);
  REQUIRE(sensor.telemetry.has_value());
  CHECK(sensor.telemetry->last_pps == drivers::PpsState::kLocked);
  CHECK(sensor.telemetry->nmea_valid == 57);
  CHECK_THAT(sensor.telemetry->nmea_example, Contains("$GPRMC,081802.00,A,"));
  REQUIRE(sensor.clock.has_value());
  CHECK_FALSE(sensor.clock->agrees);
  CHECK_FALSE(sensor.clock->drift_ppm.has_value());
  const std::string config = make_recording_config({&capture, &sensor, nullptr}, {});
  CHECK_THAT(config, Contains("time_source: \"sensor\""));
}

TEST_CASE("the configuration written for every real capture is accepted and contains its model",
          "[inspect_captures]") {
  const std::array<std::pair<const char*, const char*>, 4> files{{{"hdl32e_highway_moving.pcap", "HDL-32E"},
                                                                  {"vlp16_short.pcap", "VLP-16"},
                                                                  {"golden/vlp16.pcap", "VLP-16"},
                                                                  {"golden/vls128.pcap", "VLS-128"}}};
  for (const auto& [name, model] : files) {
    NILIO_REQUIRE_DATA(path, std::string("velodyne/") + name);
    const tests::TemporaryFile config_file("", ".yaml");
    CHECK(tests::run_inspect(path.string() + " --write-config " + config_file.path()).status == 0);
    daemon::Config config;
    const auto applied = daemon::apply_file(config, config_file.path());
    INFO((applied ? "" : applied.error().message));
    REQUIRE(applied.ok());
    CHECK(config.lidar.model == model);
    // No other key differs from the defaults.
    daemon::Config expected;
    expected.lidar.model = model;
    CHECK(daemon::to_yaml(config) == daemon::to_yaml(expected));
  }
}

TEST_CASE("a car's CAN log is distinguished from an IMU's", "[inspect_captures]") {
  NILIO_REQUIRE_DATA(packed, "can/toyota_rav4_60s_candump.log.xz");
  const auto result = tests::run_inspect(packed.string());
  CHECK(result.status == 1);
  CHECK_THAT(result.errors, Contains("compressed (xz)") && Contains("unxz"));
  const tests::TemporaryFile log("", ".log");
  REQUIRE(std::system(("xz -dkc '" + packed.string() + "' > '" + log.path() + "'").c_str()) == 0);
  const RecordingFindings findings = inspect_recording({log.path()});
  REQUIRE(findings.can_logs.size() == 1);
  const CanFindings& can = findings.can_logs.front();
  CHECK(can.frames == 98'800);
  CHECK(can.interfaces.size() == 2);
  CHECK(can.broken_lines == 0);
  CHECK(can.imu() == nullptr);
  CHECK_FALSE(can.has_wall_clock());
  const auto kinematics =
      std::find_if(can.messages.begin(), can.messages.end(),
                   [](const CanMessageFindings& m) { return m.interface_name == "can0" && m.id == 0x024; });
  REQUIRE(kinematics != can.messages.end());
  CHECK(kinematics->rate_hz() == Approx(82.9).margin(0.1));
}

TEST_CASE("with its DBC a car's messages have names and all their frames are decoded", "[inspect_captures]") {
  NILIO_REQUIRE_DATA(packed, "can/toyota_rav4_60s_candump.log.xz");
  NILIO_REQUIRE_DATA(dbc, "can/toyota_2017.dbc");
  const tests::TemporaryFile log("", ".log");
  REQUIRE(std::system(("xz -dkc '" + packed.string() + "' > '" + log.path() + "'").c_str()) == 0);
  const auto result = tests::run_inspect(log.path() + " --dbc " + dbc.string() + " --json -");
  REQUIRE(result.status == 0);
  const auto messages = nlohmann::json::parse(result.output)["can_logs"][0]["messages"];
  const auto kinematics = std::find_if(messages.begin(), messages.end(), [](const nlohmann::json& m) {
    return m["interface"] == "can0" && m["id"] == 0x024;
  });
  REQUIRE(kinematics != messages.end());
  CHECK((*kinematics)["name"] == "KINEMATICS");
  const auto& yaw_rate = (*kinematics)["signals"]["YAW_RATE"];
  CHECK(yaw_rate["physical"]["count"] == (*kinematics)["frames"]);
  CHECK(yaw_rate["unit"] == "deg/s");
  CHECK(std::abs(yaw_rate["physical"]["mean"].get<double>()) < 20.0);
  const auto report = tests::run_inspect(log.path() + " --dbc " + dbc.string());
  CHECK_THAT(report.output, Contains("KINEMATICS") && Contains("YAW_RATE") && Contains("gaps"));
  const auto missing = tests::run_inspect(log.path() + " --dbc /nonexistent.dbc");
  CHECK(missing.status == 1);
  CHECK_THAT(missing.errors, Contains("/nonexistent.dbc"));
}
