#include "nilio/drivers/velodyne/clock/position_packet.hpp"

#include "tests/support/tools/inspect_support.hpp"
#include "tools/inspect/clock.hpp"
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

TurningSensor turning(VelodyneModel model, double revolutions_per_second = 10.0) {
  return {.sensor = drivers::make_velodyne_sensor(model), .revolutions_per_second = revolutions_per_second};
}

void add_packets(CaptureBuilder& capture, const TurningSensor& sensor, std::uint32_t address,
                 std::uint16_t port, std::size_t first, std::size_t count) {
  for (std::size_t i = first; i < first + count; ++i) {
    const drivers::Packet packet = sensor.packet(i);
    capture.udp(packet.stamp.ns, address, port, payload_of(packet));
  }
}

const SensorFindings& only_sensor(const RecordingFindings& findings) {
  REQUIRE(findings.captures.size() == 1);
  REQUIRE(findings.captures.front().sensors.size() == 1);
  return findings.captures.front().sensors.front();
}

/// Problem reported for a file of these bytes.
std::string problem_of(const std::string& bytes, const std::string& suffix) {
  const RecordingFindings findings = inspect_bytes(bytes, suffix);
  CHECK_FALSE(findings.usable());
  REQUIRE(findings.problems.size() == 1);
  return findings.problems.front();
}

}  // namespace

TEST_CASE("sensors on two addresses are separate, each with its own telemetry", "[inspect]") {
  const TurningSensor slow = turning(VelodyneModel::kVlp16, 10.0);
  const TurningSensor fast = turning(VelodyneModel::kVlp32c, 20.0);
  drivers::PositionPacket position;
  position.pps = drivers::PpsState::kLocked;
  position.health.top_board_degc = 41;
  CaptureBuilder capture;
  for (std::size_t i = 0; i < 300; ++i) {
    add_packets(capture, slow, kFirstSensor, 2368, i, 1);
    add_packets(capture, fast, kSecondSensor, 2368, 2 * i, 2);
    if (i % 10 == 0)
      capture.udp(slow.packet(i).stamp.ns, kSecondSensor, 8308, drivers::encode_position_packet(position));
  }
  const RecordingFindings findings = inspect_bytes(capture.bytes(), ".pcap");
  REQUIRE(findings.captures.size() == 1);
  const std::vector<SensorFindings>& sensors = findings.captures.front().sensors;
  REQUIRE(sensors.size() == 2);
  CHECK(sensors[0].model == VelodyneModel::kVlp16);
  CHECK(sensors[0].packets == 300);
  CHECK(sensors[0].revolutions_per_minute.mean() == Approx(600.0).epsilon(0.002));
  CHECK_FALSE(sensors[0].telemetry.has_value());
  CHECK(sensors[1].model == VelodyneModel::kVlp32c);
  CHECK(sensors[1].packets == 600);
  CHECK(sensors[1].revolutions_per_minute.mean() == Approx(1200.0).epsilon(0.002));
  REQUIRE(sensors[1].telemetry.has_value());
  CHECK(sensors[1].telemetry->packets == 30);
  CHECK(sensors[1].telemetry->last_pps == drivers::PpsState::kLocked);
  CHECK(sensors[1].telemetry->top_board_degc.mean() == Approx(41.0));
  for (const SensorFindings& sensor : sensors) CHECK(sensor.stats.lost_packets == 0);
}

TEST_CASE("missing, repeated and truncated packets are counted", "[inspect]") {
  const TurningSensor sensor = turning(VelodyneModel::kVlp16);
  CaptureBuilder capture;
  add_packets(capture, sensor, kFirstSensor, 2368, 0, 200);
  add_packets(capture, sensor, kFirstSensor, 2368, 205, 100);
  add_packets(capture, sensor, kFirstSensor, 2368, 304, 1);
  const drivers::Packet packet = sensor.packet(305);
  capture.udp(packet.stamp.ns, kFirstSensor, 2368, payload_of(packet).first(1000));
  capture.frame(packet.stamp.ns, 0x0806);
  const RecordingFindings findings = inspect_bytes(capture.bytes(), ".pcap");
  const SensorFindings& found = only_sensor(findings);
  CHECK(found.stats.lost_packets == 5);
  CHECK(found.stats.duplicate_packets == 1);
  CHECK(found.stats.bad_length == 1);
  CHECK(findings.captures.front().not_ipv4 == 1);
  CHECK_THAT(sensor_report(found),
             Contains("5 lost") && Contains("1 duplicate") && Contains("1 of wrong length"));
}

TEST_CASE("a pause longer than a revolution is a gap", "[inspect]") {
  const TurningSensor sensor = turning(VelodyneModel::kVlp16);
  CaptureBuilder capture;
  add_packets(capture, sensor, kFirstSensor, 2368, 0, 200);
  add_packets(capture, sensor, kFirstSensor, 2368, 500, 200);
  const RecordingFindings findings = inspect_bytes(capture.bytes(), ".pcap");
  const SensorFindings& found = only_sensor(findings);
  CHECK(found.gaps == 1);
  CHECK(found.longest_pause_s == Approx(301 * 1327.104e-6).margin(1e-4));
}

TEST_CASE("values that need a whole revolution are reported as unknown for a shorter capture", "[inspect]") {
  CaptureBuilder capture;
  add_packets(capture, turning(VelodyneModel::kVlp16), kFirstSensor, 2368, 0, 10);
  const RecordingFindings findings = inspect_bytes(capture.bytes(), ".pcap");
  CHECK(findings.usable());
  CHECK(only_sensor(findings).complete_scans == 0);
  CHECK_THAT(inspect_report(findings), Contains("field of view  unknown") && Contains("no complete scan"));
}

TEST_CASE("a capture that ends within a record is reported and read up to there", "[inspect]") {
  CaptureBuilder capture;
  add_packets(capture, turning(VelodyneModel::kVlp16), kFirstSensor, 2368, 0, 300);
  const std::string bytes = capture.bytes();
  const RecordingFindings findings = inspect_bytes(bytes.substr(0, bytes.size() - 700), ".pcap");
  CHECK(findings.usable());
  CHECK(only_sensor(findings).packets == 299);
  CHECK_THAT(inspect_report(findings), Contains("ends in the middle of a record"));
}

TEST_CASE("files without usable contents are reported with their kind and the remedy", "[inspect]") {
  CHECK_THAT(problem_of("", ".pcap"), Contains("is empty (0 bytes)") && Contains("record again"));
  CHECK_THAT(problem_of("hello\n", ".txt"), Contains("neither a capture") && Contains("candump -L"));
  CHECK_THAT(problem_of("hello\n", ".pcap"), Contains("is no capture"));
  CHECK_THAT(problem_of("\x1F\x8B\x08", ".pcap.gz"), Contains("gunzip"));
  CHECK_THAT(problem_of("(broken\n", ".candump"), Contains("no CAN frame") && Contains("1 broken lines"));
  CaptureBuilder none;
  CHECK_THAT(problem_of(none.bytes(), ".pcap"), Contains("without packets") && Contains("tcpdump"));
  CaptureBuilder arp;
  arp.frame(kEpochNs, 0x0806);
  CHECK_THAT(problem_of(arp.bytes(), ".pcap"),
             Contains("no UDP over IPv4") && Contains("1 that are not IPv4"));
  CaptureBuilder other;
  other.udp(kEpochNs, kFirstSensor, 5353, std::vector<std::uint8_t>(100));
  CHECK_THAT(problem_of(other.bytes(), ".pcap"), Contains("1 to port 5353") && Contains("1206 bytes"));
  CaptureBuilder telemetry;
  telemetry.udp(kEpochNs, kFirstSensor, 8308, drivers::encode_position_packet({}));
  CHECK_THAT(problem_of(telemetry.bytes(), ".pcap"),
             Contains("telemetry of 192.168.1.201, but no data packets"));
}

TEST_CASE("damaged bytes anywhere in a capture do not crash the inspection", "[inspect]") {
  CaptureBuilder capture;
  add_packets(capture, turning(VelodyneModel::kVlp16), kFirstSensor, 2368, 0, 80);
  std::uint32_t random = 1;
  for (int round = 0; round < 200; ++round) {
    std::string bytes = capture.bytes();
    for (int i = 0; i < 20; ++i) {
      random = random * 1664525U + 1013904223U;
      // Half of the damage is in the headers of the first records.
      const std::size_t at = (random >> 8) % (i % 2 == 0 ? 2600 : bytes.size());
      bytes[at] = static_cast<char>(random >> 3 & 0xFFU);
    }
    const RecordingFindings findings = inspect_bytes(bytes, ".pcap");
    CHECK((findings.usable() || !findings.problems.empty()));
    CHECK(nlohmann::json::parse(inspect_json(findings)).at("usable") == findings.usable());
    CHECK((inspect_report(findings).empty() == findings.captures.empty()));
  }
}

TEST_CASE("a fast clock is reported with its offset at the start and its drift", "[inspect]") {
  constexpr std::int64_t kPeriodNs = 1'000'000;
  constexpr double kDriftPpm = 40.0;
  ClockComparison clock;
  for (std::int64_t i = 0; i < 30'000; ++i) {
    // Every third packet is stamped up to 3 ms late.
    const std::int64_t late_ns = i % 3 == 0 ? i % 7 * 500'000 : 0;
    const std::int64_t true_ns = i * kPeriodNs;
    const double sensor_ns = static_cast<double>(true_ns) * (1.0 + kDriftPpm * 1e-6) + 90e9;
    clock.add(static_cast<std::uint32_t>(sensor_ns / 1000.0),
              core::Time{true_ns + late_ns + 3'600'000'000'000}, 0);
  }
  const auto found = clock.findings();
  REQUIRE(found.has_value());
  CHECK(found->offset_s == Approx(90.0).margin(1e-3));
  CHECK_FALSE(found->agrees);
  REQUIRE(found->drift_ppm.has_value());
  CHECK(*found->drift_ppm == Approx(kDriftPpm).margin(1.0));
}

TEST_CASE("a clock that passes the hour does not jump", "[inspect]") {
  ClockComparison clock;
  for (std::int64_t i = 0; i < 20'000; ++i) {
    const std::int64_t now_ns = 3'590'000'000'000 + i * 1'000'000;
    clock.add(static_cast<std::uint32_t>(now_ns / 1000 % 3'600'000'000), core::Time{now_ns + 100'000}, 0);
  }
  const auto found = clock.findings();
  REQUIRE(found.has_value());
  CHECK(found->agrees);
  CHECK(found->offset_s == Approx(-100e-6).margin(2e-6));
  REQUIRE(found->drift_ppm.has_value());
  CHECK(*found->drift_ppm == Approx(0.0).margin(0.5));
}
