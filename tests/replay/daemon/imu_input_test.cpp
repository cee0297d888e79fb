#include "nilio/drivers/capture/capture_reader.hpp"

#include "daemon/config/schema.hpp"
#include "daemon/input/input.hpp"
#include "daemon/input/replay_files.hpp"
#include "daemon/odometry/pipeline.hpp"
#include "tests/support/capture_bytes.hpp"
#include "tests/support/replay_run.hpp"
#include "tests/support/room_drive.hpp"

#include <algorithm>
#include <fstream>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using Catch::Matchers::Contains;
using nilio::tests::ReplayRun;
using nilio::tests::run_replay;
using nilio::tests::scans_with_imu;
using nilio::tests::TemporaryFolder;

namespace {

std::uint64_t imu_samples(const ReplayRun& run) { return run.pipeline->counters().imu_samples.load(); }

bool any_contains(const std::vector<std::string>& notes, const std::string& text) {
  return std::any_of(notes.begin(), notes.end(),
                     [&](const std::string& note) { return note.find(text) != std::string::npos; });
}

/// CAN frame in the format of SocketCAN captures.
std::string socketcan_bytes(const drivers::CanFrame& frame) {
  tests::ByteText text(true);
  text.u32(frame.id | (frame.extended ? 0x80000000U : 0U))
      .text(std::string(1, static_cast<char>(frame.length)));
  text.text(std::string(3, '\0'));
  return text.text({reinterpret_cast<const char*>(frame.data.data()), frame.length}).bytes();
}

/// Merges the drive's LiDAR packets and CAN frames by time into one pcapng with two interfaces.
void write_one_capture(const std::filesystem::path& folder, const std::filesystem::path& output) {
  struct Record {
    std::int64_t stamp_ns;
    std::uint32_t interface;
    std::string bytes;
  };
  std::vector<Record> records;
  auto reader = drivers::open_capture((folder / "lidar.pcap").string());
  REQUIRE(reader.ok());
  for (drivers::CapturedFrame frame; (*reader)->next(frame) == drivers::CaptureRead::kFrame;)
    records.push_back({frame.stamp_ns, 0, {frame.bytes.begin(), frame.bytes.end()}});
  std::ifstream log(folder / "imu.log");
  for (std::string line; std::getline(log, line);) {
    const auto parsed = drivers::parse_candump_line(line);
    REQUIRE(parsed.has_value());
    records.push_back({parsed->frame.stamp.ns, 1, socketcan_bytes(parsed->frame)});
  }
  std::stable_sort(records.begin(), records.end(),
                   [](const Record& a, const Record& b) { return a.stamp_ns < b.stamp_ns; });
  tests::PcapngText text;
  const std::string nanoseconds = text.option(9, "\x09");
  text.interface(tests::kLinkEthernet, text.option(2, "eth0") + nanoseconds);
  text.interface(tests::kLinkCan, text.option(2, "can0") + nanoseconds);
  for (const Record& record : records)
    text.packet(record.interface, static_cast<std::uint64_t>(record.stamp_ns), record.bytes);
  std::ofstream(output, std::ios::binary) << text.bytes();
}

}  // namespace

TEST_CASE("LiDAR and CAN in one capture give the same result as in two files", "[imu_input][pipeline]") {
  const TemporaryFolder apart;
  tests::write_room_drive(apart.path(), tests::s_curve, 3.0, true);
  const TemporaryFolder together;
  const std::filesystem::path capture = together.path() / "drive.pcapng";
  write_one_capture(apart.path(), capture);
  const ReplayRun two = run_replay(apart.path().string());
  const ReplayRun one = run_replay(capture.string());
  CHECK(any_contains(one.notes, "from " + capture.string()));
  CHECK(imu_samples(one) == imu_samples(two));
  CHECK(scans_with_imu(one) == scans_with_imu(two));
  CHECK(scans_with_imu(one) > 0);
  REQUIRE(one.poses.size() == two.poses.size());
  for (std::size_t i = 0; i < one.poses.size(); ++i) {
    CHECK(one.poses[i].position == two.poses[i].position);
    CHECK(one.poses[i].orientation_xyzw == two.poses[i].orientation_xyzw);
  }
}

TEST_CASE("imu.time_offset_ms is subtracted from the IMU's stamps and logged", "[imu_input][pipeline]") {
  const TemporaryFolder folder;
  tests::write_room_drive(folder.path(), tests::s_curve, 2.0, true);
  const ReplayRun sound = run_replay(folder.path().string());
  // Same log with stamps 40 ms later.
  std::vector<std::string> lines;
  {
    std::ifstream log(folder.path() / "imu.log");
    for (std::string line; std::getline(log, line);) {
      auto parsed = drivers::parse_candump_line(line);
      REQUIRE(parsed.has_value());
      parsed->frame.stamp = parsed->frame.stamp + core::Duration::from_milliseconds(40.0);
      lines.push_back(drivers::format_candump_line(parsed->frame, "can0"));
    }
  }
  std::ofstream log(folder.path() / "imu.log");
  for (const std::string& line : lines) log << line << '\n';
  log.close();
  Config config;
  config.imu.time_offset_ms = 40.0;
  const ReplayRun corrected = run_replay(folder.path().string(), config);
  CHECK(any_contains(corrected.notes, "40.000 ms later than the LiDAR's"));
  CHECK(scans_with_imu(sound) > 0);
  CHECK(scans_with_imu(corrected) == scans_with_imu(sound));
  REQUIRE(corrected.poses.size() == sound.poses.size());
  for (std::size_t i = 0; i < sound.poses.size(); ++i)
    CHECK(corrected.poses[i].position == sound.poses[i].position);
}

TEST_CASE("a recording of every IMU preset needs no configuration, and each preset can be configured",
          "[imu_input][pipeline]") {
  const TemporaryFolder folder;
  tests::write_room_drive(folder.path(), tests::s_curve, 2.0, false);
  for (const std::string& name : drivers::imu_preset_names()) {
    INFO(name);
    tests::write_imu_log(folder.path(), tests::s_curve, 2.0, name);
    const ReplayRun found = run_replay(folder.text());
    CHECK(any_contains(found.notes, "IMU " + name + " from "));
    CHECK(any_contains(found.notes, "identified by frames 0x"));
    CHECK(any_contains(found.notes, "taken as 0") == (name == "bosch_mm5_10"));
    CHECK(imu_samples(found) > 150);
    Config config;
    REQUIRE(apply_override(config, "imu.preset=" + name).ok());
    const ReplayRun configured = run_replay(folder.text(), config);
    CHECK_FALSE(any_contains(configured.notes, "identified"));
    CHECK(imu_samples(configured) == imu_samples(found));
    REQUIRE(configured.poses.size() == found.poses.size());
    for (std::size_t i = 0; i < found.poses.size(); ++i)
      CHECK(configured.poses[i].position == found.poses[i].position);
  }
}

TEST_CASE("a log that decodes to no sample is an error that names the command to inspect it",
          "[imu_input][pipeline]") {
  const TemporaryFolder folder;
  tests::write_room_drive(folder.path(), tests::s_curve, 0.3, true);
  const auto files = find_replay_files({folder.text()});
  REQUIRE(files.ok());
  Config config;
  const auto expect = [&](const std::string& reason) {
    const auto input = open_replay(*files, config);
    REQUIRE_FALSE(input.ok());
    CHECK_THAT(input.error().message, Contains("imu.log: no sample") && Contains(reason) &&
                                          Contains("nilio inspect " + folder.text() + " --write-config"));
  };
  config.imu.preset = "sbg_ellipse";
  expect("of the configured IMU (sbg_ellipse)");
  config.imu.preset = "auto";
  std::ofstream(folder.file("imu.log")) << "(1767268800.000000) can0 123#0011223344556677\n";
  expect("of a built-in IMU (imu.preset: auto)");
  config.imu.enabled = false;
  CHECK(open_replay(*files, config).ok());
}

TEST_CASE("a custom mapping supports counter, status, time and temperature and requires its DBC file",
          "[imu_input][pipeline]") {
  const TemporaryFolder folder;
  tests::write_room_drive(folder.path(), tests::s_curve, 0.3, true);
  const auto files = find_replay_files({folder.path().string()});
  REQUIRE(files.ok());
  std::ofstream(folder.path() / "own.dbc") << R"(VERSION ""
BU_: IMU
BO_ 50 Rates: 8 IMU
 SG_ RateX : 0|16@1- (0.01,0) [0|0] "deg/s" IMU
 SG_ RateY : 16|16@1- (0.01,0) [0|0] "deg/s" IMU
 SG_ RateZ : 32|16@1- (0.01,0) [0|0] "deg/s" IMU
 SG_ Number : 48|8@1+ (1,0) [0|0] "" IMU
 SG_ State : 56|8@1+ (1,0) [0|0] "" IMU
BO_ 51 Forces: 8 IMU
 SG_ ForceX : 0|16@1- (0.001,0) [0|0] "g" IMU
 SG_ ForceY : 16|16@1- (0.001,0) [0|0] "g" IMU
 SG_ ForceZ : 32|16@1- (0.001,0) [0|0] "g" IMU
 SG_ Degrees : 48|16@1- (0.1,0) [0|0] "degC" IMU
BO_ 52 Clock: 4 IMU
 SG_ Ticks : 0|32@1+ (1,0) [0|0] "us" IMU
)";
  Config config;
  const auto set = [&](const std::string& assignment) { REQUIRE(apply_override(config, assignment).ok()); };
  for (const std::string axis : {"x", "y", "z"}) {
    const std::string letter(1, static_cast<char>(axis[0] - 'a' + 'A'));
    set("imu.angular_velocity_" + axis + ".message=Rates");
    set("imu.angular_velocity_" + axis + ".signal=Rate" + letter);
    set("imu.angular_velocity_" + axis + ".scale=0.0174533");
    set("imu.linear_acceleration_" + axis + ".message=Forces");
    set("imu.linear_acceleration_" + axis + ".signal=Force" + letter);
    set("imu.linear_acceleration_" + axis + ".scale=9.80665");
  }
  set("imu.counter.message=Rates");
  set("imu.counter.signal=Number");
  set("imu.status.message=Rates");
  set("imu.status.signal=State");
  set("imu.status.mask=15");
  set("imu.sample_time.message=Clock");
  set("imu.sample_time.signal=Ticks");
  set("imu.temperature.message=Forces");
  set("imu.temperature.signal=Degrees");
  const auto stray = open_replay(*files, config);
  REQUIRE_FALSE(stray.ok());
  CHECK_THAT(stray.error().message, Contains("'Rates'") && Contains("set imu.dbc"));
  set("imu.dbc=" + (folder.path() / "own.dbc").string());
  std::ofstream(folder.file("imu.log")) << "(1767268800.000000) can0 034#00000000\n"
                                           "(1767268800.000001) can0 032#0000000000000000\n"
                                           "(1767268800.000002) can0 033#0000000000000000\n";
  auto input = open_replay(*files, config);
  REQUIRE(input.ok());
  const auto frame = [](std::uint32_t id, std::vector<std::uint8_t> bytes, std::int64_t ms) {
    drivers::CanFrame result;
    result.id = id;
    result.length = static_cast<std::uint8_t>(bytes.size());
    std::copy(bytes.begin(), bytes.end(), result.data.begin());
    result.stamp = core::Time{ms * 1'000'000};
    return result;
  };
  drivers::ImuDecoder& decoder = *input->imu_decoder;
  std::optional<core::ImuSample> sample;
  for (const std::uint8_t state : {std::uint8_t{0}, std::uint8_t{1}}) {
    const std::int64_t ms = 1000 + 10 * state;
    decoder.add(frame(52, {state, 0, 0, 0}, ms));
    decoder.add(frame(50, {0xE8, 0x03, 0, 0, 0, 0, state, state}, ms));
    const auto made = decoder.add(frame(51, {0, 0, 0, 0, 0xE8, 0x03, 0xFA, 0x00}, ms));
    if (made) sample = made;
  }
  REQUIRE(sample.has_value());
  CHECK(sample->angular_velocity[0] == Approx(0.174533));
  CHECK(sample->linear_acceleration[2] == Approx(9.80665));
  CHECK(decoder.stats().samples == 1);
  CHECK(decoder.stats().bad_status == 1);
  CHECK(decoder.temperature_degc() == Approx(25.0));
  set("imu.counter.signal=Numbre");
  const auto misspelt = open_replay(*files, config);
  REQUIRE_FALSE(misspelt.ok());
  CHECK_THAT(misspelt.error().message, Contains("Numbre") && Contains("Number"));
}
