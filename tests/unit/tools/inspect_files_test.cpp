#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/imu/decoder.hpp"

#include "daemon/config/schema.hpp"
#include "daemon/input/input.hpp"
#include "tests/support/hdl64e_support.hpp"
#include "tests/support/tools/inspect_support.hpp"
#include "tests/support/tools/simulate_support.hpp"
#include "tools/inspect/config.hpp"
#include "tools/inspect/report/report.hpp"

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::inspect;
using namespace nilio::tests;
using Catch::Matchers::Contains;
using drivers::VelodyneModel;

namespace {

/// `seconds` of a stationary IMU at 100 Hz.
std::string imu_log(const std::string& preset_name, double seconds, const core::ImuSample& sample,
                    std::int64_t start_ns = kEpochNs, const std::string& interface_name = "can0") {
  const drivers::ImuPreset preset = drivers::imu_preset(preset_name).value();
  std::string text;
  for (int i = 0; i < static_cast<int>(seconds * 100.0); ++i) {
    core::ImuSample now = sample;
    now.stamp = core::Time{start_ns + std::int64_t{i} * 10'000'000};
    for (const drivers::CanFrame& frame : drivers::encode_imu_sample(now, preset))
      text += drivers::format_candump_line(frame, interface_name) + "\n";
  }
  return text;
}

core::ImuSample stationary_sample() {
  return {.stamp = {}, .angular_velocity = {0.01, -0.02, 0.03}, .linear_acceleration = {0.0, 0.0, 9.81}};
}

std::string vlp16_capture(std::uint32_t address, std::uint16_t port, std::size_t packets = 300) {
  const TurningSensor sensor{.sensor = drivers::make_velodyne_sensor(VelodyneModel::kVlp16)};
  CaptureBuilder capture;
  for (std::size_t i = 0; i < packets; ++i) {
    const drivers::Packet packet = sensor.packet(i);
    capture.udp(packet.stamp.ns, address, port, payload_of(packet));
  }
  return capture.bytes();
}

/// More than one pass of the status stream: about 1.3 s.
std::string hdl64e_capture() {
  const TurningSensor sensor{.sensor = drivers::make_velodyne_sensor(VelodyneModel::kHdl64eS2)};
  drivers::Hdl64eStatusWriter writer = make_writer();
  CaptureBuilder capture;
  for (std::size_t i = 0; i < drivers::kHdl64eStatusPackets + 300; ++i) {
    drivers::VelodyneDataPacket data = sensor.data(i);
    const drivers::Hdl64eStatusByte status = writer.next(some_readings());
    data.factory_byte_1 = status.type;
    data.factory_byte_2 = status.value;
    capture.udp(sensor.packet(i).stamp.ns, kFirstSensor, 2368, drivers::encode(data));
  }
  return capture.bytes();
}

void write(const std::filesystem::path& path, const std::string& content) {
  std::ofstream(path, std::ios::binary) << content;
}

daemon::Config load(const std::string& path) {
  daemon::Config config;
  const auto applied = daemon::apply_file(config, path);
  INFO((applied ? "" : applied.error().message));
  REQUIRE(applied.ok());
  return config;
}

}  // namespace

TEST_CASE("the frames of every IMU preset are recognised, with rate, bias and attitude", "[inspect_files]") {
  for (const std::string& preset : drivers::imu_preset_names()) {
    const drivers::ImuPreset built_in = drivers::imu_preset(preset).value();
    // Presets with fewer than six axes are not for odometry.
    if (!drivers::ImuDecoder::create(built_in.mapping, built_in.database)) continue;
    INFO(preset);
    const RecordingFindings findings = inspect_bytes(imu_log(preset, 5.0, stationary_sample()), ".log");
    REQUIRE(findings.can_logs.size() == 1);
    const ImuFindings* imu = findings.can_logs.front().imu();
    REQUIRE(imu != nullptr);
    CHECK(imu->preset == preset);
    CHECK(imu->interface_name == "can0");
    CHECK(imu->stats.samples == 500);
    CHECK(imu->stats.incomplete == 0);
    CHECK(imu->rate_hz() == Approx(100.0).epsilon(1e-3));
    CHECK(imu->acceleration_m_s2.mean() == Approx(9.81).margin(0.01));
    CHECK(imu->still_seconds == 4);
    CHECK(imu->still_angular_velocity[2].mean() == Approx(0.03).margin(0.002));
    CHECK(imu->tilt_deg().value_or(90.0) < 0.1);
  }
}

TEST_CASE("an inverted IMU, other units and missing IMU messages are reported", "[inspect_files]") {
  core::ImuSample turned = stationary_sample();
  turned.linear_acceleration[2] = -9.81;
  CHECK_THAT(inspect_report(inspect_bytes(imu_log("xsens_mti", 3.0, turned), ".log")),
             Contains("UPSIDE DOWN"));
  core::ImuSample in_g = stationary_sample();
  in_g.linear_acceleration[2] = 1.0;
  const RecordingFindings other = inspect_bytes(imu_log("xsens_mti", 3.0, in_g), ".log");
  CHECK(other.can_logs.at(0).imu() == nullptr);
  CHECK_THAT(inspect_report(other), Contains("another device"));
  std::string half;
  std::istringstream lines(imu_log("xsens_mti", 3.0, stationary_sample()));
  for (std::string line; std::getline(lines, line);)
    if (line.find("034#") != std::string::npos) half += line + "\n";
  CHECK_THAT(inspect_report(inspect_bytes(half, ".log")), Contains("some of its messages are missing"));
}

TEST_CASE("broken lines, error frames and overlong lines of a CAN log are counted", "[inspect_files]") {
  const std::string log = imu_log("xsens_mti", 1.0, stationary_sample()) + "(1700000001.5) can0 zzz\n" +
                          "(9000000000.000000) can0 032#000000000000\n" +
                          "(1700000001.600000) can0 20000004#0000000000000000\n(" +
                          std::string(100'000, 'x') + "\n" + "comment\n(1700000001.700000) can1 123#00\n";
  const RecordingFindings findings = inspect_bytes(log, ".log");
  REQUIRE(findings.can_logs.size() == 1);
  const CanFindings& can = findings.can_logs.front();
  CHECK(can.frames == 202);
  CHECK(can.error_frames == 1);
  CHECK(can.broken_lines == 3);
  CHECK(can.duration_s() < 2.0);
  CHECK(can.first_broken_line == 201);
  CHECK(can.interfaces.at("can0") == 200);
  CHECK(can.interfaces.at("can1") == 1);
}

TEST_CASE("a CAN log without overlap with the capture is reported with the time between them",
          "[inspect_files]") {
  const TemporaryFolder folder;
  write(folder.path() / "lidar.pcap", vlp16_capture(kFirstSensor, 2368));
  write(folder.path() / "imu.log",
        imu_log("xsens_mti", 2.0, stationary_sample(), kEpochNs + 100'000'000'000));
  const RecordingFindings apart = inspect_recording({folder.path().string()});
  REQUIRE((apart.captures.size() == 1 && apart.can_logs.size() == 1));
  const TimeRelation relation = relate(apart.can_logs[0], apart.captures[0]);
  CHECK(relation.overlap_s == 0.0);
  CHECK(relation.start_offset_s == Approx(100.0).margin(0.01));
  CHECK(relation.apart_s == Approx(99.6).margin(0.01));
  CHECK_THAT(inspect_report(apart), Contains("NO OVERLAP") && Contains("99.602 s apart"));
  CHECK_THAT(
      make_recording_config({&apart.captures[0], &apart.captures[0].sensors.at(0), &apart.can_logs[0]}, {}),
      Contains("and the capture do not overlap: they are 99.602 s apart"));
  write(folder.path() / "imu.log", imu_log("xsens_mti", 2.0, stationary_sample()));
  const RecordingFindings together = inspect_recording({folder.path().string()});
  CHECK(relate(together.can_logs[0], together.captures[0]).apart_s == 0.0);
  CHECK_THAT(inspect_report(together), Contains("covers 100.0 %"));
}

TEST_CASE("the configuration contains differing ports, sender and IMU, and a replay accepts it",
          "[inspect_files]") {
  const TemporaryFolder folder;
  const auto capture = folder.path() / "lidar.pcap";
  const auto yaml = folder.path() / "nilio.yaml";
  std::string both = vlp16_capture(kFirstSensor, 3000);
  both += vlp16_capture(kSecondSensor, 3000, 200).substr(24);
  write(capture, both);
  write(folder.path() / "imu.log", imu_log("oxts_rt3003", 1.0, stationary_sample(), kEpochNs, "can1") +
                                       "(1700000000.000000) can0 123#00\n");
  const CommandResult result = run_inspect(folder.path().string() + " --write-config " + yaml.string());
  INFO(result.errors);
  REQUIRE(result.status == 0);
  const daemon::Config config = load(yaml.string());
  CHECK(config.lidar.model == "VLP-16");
  CHECK(config.lidar.port == 3000);
  CHECK(config.lidar.sender_address == "192.168.1.201");
  CHECK(config.imu.preset == "oxts_rt3003");
  CHECK(config.imu.interface_name == "can1");
  CHECK(config.imu.enabled);
  CHECK_THAT(read_file(yaml), Contains("# other sensors send to the same port: 192.168.1.202"));
  const auto files = daemon::find_replay_files({folder.path().string()});
  REQUIRE(files.ok());
  CHECK(daemon::open_replay(*files, config).ok());
  const CommandResult second =
      run_inspect(folder.path().string() + " --sensor 192.168.1.202 --write-config " + yaml.string());
  CHECK(second.status == 0);
  CHECK(load(yaml.string()).lidar.sender_address == "192.168.1.202");
  const CommandResult unknown =
      run_inspect(folder.path().string() + " --sensor 10.0.0.1 --write-config " + yaml.string());
  CHECK(unknown.status == 1);
  CHECK_THAT(unknown.errors, Contains("192.168.1.201:3000, 192.168.1.202:3000"));
}

TEST_CASE("a CAN log without a known IMU disables the IMU in the configuration", "[inspect_files]") {
  const TemporaryFolder folder;
  write(folder.path() / "lidar.pcap", vlp16_capture(kFirstSensor, 2368));
  write(folder.path() / "car.log", "(1700000000.000000) can0 123#00\n");
  const std::string yaml = (folder.path() / "nilio.yaml").string();
  REQUIRE(run_inspect(folder.path().string() + " --write-config " + yaml).status == 0);
  CHECK_FALSE(load(yaml).imu.enabled);
}

TEST_CASE("an HDL-64E's own calibration is found, saved and referenced in the configuration",
          "[inspect_files]") {
  const TemporaryFolder folder;
  write(folder.path() / "lidar.pcap", hdl64e_capture());
  const std::string yaml = (folder.path() / "nilio.yaml").string();
  const std::string calibration = (folder.path() / "unit.yaml").string();
  const CommandResult result = run_inspect((folder.path() / "lidar.pcap").string() + " --write-config " +
                                           yaml + " --write-calibration " + calibration);
  INFO(result.errors);
  REQUIRE(result.status == 0);
  CHECK_THAT(result.output,
             Contains("firmware       4.07") && Contains("CRC right") && Contains("lens dirty"));
  const daemon::Config config = load(yaml);
  CHECK(config.lidar.model == "HDL-64E-S2");
  CHECK(config.lidar.calibration == calibration);
  const auto sensor =
      drivers::with_calibration_file(drivers::make_velodyne_sensor(VelodyneModel::kHdl64eS2), calibration);
  REQUIRE(sensor.ok());
  const auto sent = drivers::with_stream_calibration(drivers::make_velodyne_sensor(VelodyneModel::kHdl64eS2),
                                                     make_writer().calibration());
  REQUIRE(sent.ok());
  CHECK(sensor->lasers == sent->lasers);
}

TEST_CASE("saving the calibration of a sensor that does not send one is an error", "[inspect_files]") {
  const TemporaryFile capture(vlp16_capture(kFirstSensor, 2368), ".pcap");
  const TemporaryFile calibration("", ".yaml");
  const CommandResult result = run_inspect(capture.path() + " --write-calibration " + calibration.path());
  CHECK(result.status == 1);
  CHECK_THAT(result.errors, Contains("VLP-16") && Contains("does not send its calibration"));
}

TEST_CASE("with JSON on standard output there is only JSON, with the contents of the report",
          "[inspect_files]") {
  const TemporaryFile capture(vlp16_capture(kFirstSensor, 2368), ".pcap");
  const CommandResult result = run_inspect(capture.path() + " --json -");
  CHECK(result.status == 0);
  const nlohmann::json json = nlohmann::json::parse(result.output);
  CHECK(json.at("usable") == true);
  const nlohmann::json& sensor = json.at("captures").at(0).at("sensors").at(0);
  CHECK(sensor.at("model") == "VLP-16");
  CHECK(sensor.at("address") == "192.168.1.201");
  CHECK(sensor.at("packets").at("received") == 300);
  CHECK(sensor.at("packets").at("lost") == 0);
  CHECK(sensor.at("rpm").at("mean").get<double>() == Approx(600.0).epsilon(0.002));
  CHECK(sensor.at("hdl64e").is_null());
}

TEST_CASE("a configuration that cannot be read is an error", "[inspect_files]") {
  const TemporaryFolder folder;
  write(folder.path() / "lidar.pcap", vlp16_capture(kFirstSensor, 2368));
  write(folder.path() / "bad.yaml", "odometry:\n  thread: 2\n");
  const std::string config = (folder.path() / "bad.yaml").string();
  const CommandResult bad = run_inspect((folder.path() / "lidar.pcap").string() + " --config " + config);
  CHECK(bad.status == 1);
  CHECK_THAT(bad.errors, Contains("bad.yaml:2: unknown key 'odometry.thread'"));
}

TEST_CASE("an unfinished file in a folder is named, not inspected", "[inspect_files]") {
  const TemporaryFolder folder;
  write(folder.path() / "lidar.pcap.partial", vlp16_capture(kFirstSensor, 2368));
  const CommandResult result = run_inspect(folder.path().string());
  CHECK(result.status == 1);
  CHECK_THAT(result.errors, Contains("lidar.pcap.partial: is unfinished"));
}

TEST_CASE("missing files and folders without recordings are errors with a message", "[inspect_files]") {
  const TemporaryFolder folder;
  write(folder.path() / "notes.txt", "hello\n");
  const CommandResult empty = run_inspect(folder.path().string());
  CHECK(empty.status == 1);
  CHECK_THAT(empty.errors, Contains("no capture (pcap, pcapng), ROS bag or CAN log"));
  const CommandResult missing = run_inspect((folder.path() / "none.pcap").string());
  CHECK(missing.status == 1);
  CHECK_THAT(missing.errors, Contains("no such file or folder"));
}
