#include "nilio/core/units.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/velodyne/clock/nmea.hpp"
#include "nilio/drivers/velodyne/clock/position_packet.hpp"

#include "tests/support/drivers_support.hpp"
#include "tests/support/paths.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;

namespace {

constexpr std::int64_t kSecondNs = 1'000'000'000;
constexpr std::int64_t kWeekNs = 7 * 86'400 * kSecondNs;

/// Payloads of 512 bytes to port 8308 of a capture.
std::vector<Packet> position_packets(const std::filesystem::path& path) {
  auto source = open_pcap(path.string(), {});
  REQUIRE(source.ok());
  std::vector<Packet> packets;
  std::vector<Packet> slots(32);
  for (;;) {
    const SourceRead read = (*source)->read(slots, core::Duration{});
    if (read.state != SourceState::kData) break;
    std::copy_if(slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(read.count),
                 std::back_inserter(packets), [](const Packet& p) { return p.destination_port == 8308; });
  }
  return packets;
}

std::span<const std::uint8_t> payload(const Packet& packet) { return {packet.data.data(), packet.size}; }

/// `body` with '$', checksum and line end.
std::string sentence(const std::string& body) {
  int sum = 0;
  for (const char c : body) sum ^= c;
  const std::string digits = "0123456789ABCDEF";
  return "$" + body + "*" + digits[static_cast<std::size_t>(sum / 16)] +
         digits[static_cast<std::size_t>(sum % 16)] + "\r\n";
}

/// 2016-01-21 08:18:02 UTC, s.
constexpr std::int64_t kStationaryS = 1'453'364'282;

}  // namespace

TEST_CASE("every position packet of the captures is parsed and encodes to the same bytes", "[telemetry]") {
  struct Capture {
    const char* name;
    std::size_t count;
    bool motion, sentence;
    PpsState pps;
  };
  for (const Capture& capture : {
           Capture{"velodyne/hdl32e_highway_moving.pcap", 100, true, true, PpsState::kUnknown},
           Capture{"velodyne/hdl32e_monterey_stationary.pcap", 299, true, true, PpsState::kUnknown},
           Capture{"velodyne/vlp16_gps_stationary.pcap", 57, false, true, PpsState::kLocked},
           Capture{"velodyne/vlp16_preproduction_20hz_50rev.pcap", 367, false, false, PpsState::kUnknown},
           Capture{"velodyne/vlp16_short.pcap", 16, false, false, PpsState::kUnknown},
       }) {
    const auto path = nilio::tests::find_data(capture.name);
    if (!path) {
      WARN("skipped: no data");
      return;
    }
    const std::vector<Packet> packets = position_packets(*path);
    CHECK(packets.size() == capture.count);
    for (const Packet& packet : packets) {
      const auto parsed = parse_position_packet(payload(packet));
      REQUIRE(parsed.has_value());
      const auto bytes = encode_position_packet(*parsed);
      REQUIRE(std::equal(bytes.begin(), bytes.end(), packet.data.begin()));
      CHECK(parsed->motion.has_value() == capture.motion);
      CHECK(parsed->pps == capture.pps);
      CHECK(parse_nmea(parsed->nmea()).has_value() == capture.sentence);
      CHECK(parsed->nmea().empty() != capture.sentence);
    }
  }
}

TEST_CASE("a stationary HDL-32E measures one g upwards", "[telemetry]") {
  NILIO_REQUIRE_DATA(path, "velodyne/hdl32e_monterey_stationary.pcap");
  const std::vector<Packet> packets = position_packets(path);
  std::array<Hdl32eBoard, 3> mean{};
  for (const Packet& packet : packets) {
    const auto boards = parse_position_packet(payload(packet))->motion.value();
    for (std::size_t i = 0; i < 3; ++i) {
      mean[i].acceleration_x_m_s2 += boards[i].acceleration_x_m_s2 / static_cast<double>(packets.size());
      mean[i].acceleration_y_m_s2 += boards[i].acceleration_y_m_s2 / static_cast<double>(packets.size());
      CHECK(boards[i].temperature_degc > 30.0);
      CHECK(boards[i].temperature_degc < 50.0);
      CHECK(std::abs(boards[i].gyro_rad_s) < 40.0 * nilio::kRadiansPerDegree);
    }
  }
  const double up = (mean[0].acceleration_x_m_s2 + mean[1].acceleration_x_m_s2) / 2.0;
  const double across = (mean[0].acceleration_y_m_s2 - mean[2].acceleration_x_m_s2) / 2.0;
  const double along = (mean[1].acceleration_y_m_s2 + mean[2].acceleration_y_m_s2) / 2.0;
  CHECK(std::hypot(up, across, along) == Approx(9.80665).epsilon(0.05));
  CHECK(mean[0].acceleration_x_m_s2 == Approx(mean[1].acceleration_x_m_s2).margin(0.1));
  CHECK(mean[0].acceleration_y_m_s2 == Approx(-mean[2].acceleration_x_m_s2).margin(0.3));
  CHECK(mean[1].acceleration_y_m_s2 == Approx(mean[2].acceleration_y_m_s2).margin(0.1));
  CHECK(std::abs(up) > 9.0);
}

TEST_CASE("a receiver's sentence and the sensor's clock show the same minute and second", "[telemetry]") {
  NILIO_REQUIRE_DATA(path, "velodyne/vlp16_gps_stationary.pcap");
  for (const Packet& packet : position_packets(path)) {
    const auto parsed = parse_position_packet(payload(packet));
    const auto fix = parse_nmea(parsed->nmea(), packet.stamp);
    REQUIRE(fix.has_value());
    CHECK(fix->valid);
    CHECK(fix->utc->ns == kStationaryS * kSecondNs);
    CHECK_FALSE(fix->week_rollover_corrected);
    CHECK(fix->latitude_deg == Approx(36.0 + 49.7478558 / 60.0).margin(1e-9));
    CHECK(fix->longitude_deg == Approx(-(2.0 + 24.4542928 / 60.0)).margin(1e-9));
    CHECK(fix->speed_m_s == Approx(0.034 * 0.514444).epsilon(1e-5));
    CHECK(fix->course_deg == Approx(212.5));
    CHECK(parsed->timestamp_us / 1'000'000 == kStationaryS % 3600);
  }
}

TEST_CASE("only packets of 512 bytes are position packets", "[telemetry]") {
  const std::vector<std::uint8_t> bytes(1206, 0);
  for (const std::size_t size : {0U, 1U, 511U, 513U, 1206U}) {
    CHECK_FALSE(parse_position_packet(std::span(bytes).first(size)).has_value());
  }
  CHECK(parse_position_packet(std::span(bytes).first(512)).has_value());
}

TEST_CASE("position packets of random bytes parse to a value that encodes to the same bytes", "[telemetry]") {
  std::uint32_t state = 1;
  for (int round = 0; round < 300; ++round) {
    std::array<std::uint8_t, kPositionPacketSize> bytes{};
    for (std::uint8_t& byte : bytes) {
      state = state * 1'664'525 + 1'013'904'223;
      byte = static_cast<std::uint8_t>(state >> 24);
    }
    // Words as an HDL-32E tags them, in every other packet.
    for (std::size_t word = 0; word < 12 && round % 2 == 0; ++word) {
      std::uint8_t& high = bytes[14 + 2 * word + 1];
      high = static_cast<std::uint8_t>((high & 0x0F) | (word % 4) << 4);
    }
    const auto parsed = parse_position_packet(bytes);
    REQUIRE(parsed.has_value());
    CHECK(parsed->motion.has_value() == (round % 2 == 0));
    CHECK(parsed->nmea().size() <= kNmeaCapacity);
    CHECK(parse_position_packet(encode_position_packet(*parsed)) == parsed);
  }
}

TEST_CASE("every field of a position packet is at its documented place", "[telemetry]") {
  std::array<std::uint8_t, kPositionPacketSize> bytes{};
  const auto set = [&](std::size_t at, std::initializer_list<std::uint8_t> values) {
    std::copy(values.begin(), values.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at));
  };
  // One g down and up, one turn in 3.6864 s, 25 degrees.
  set(14, {0x00, 0x04, 0x00, 0x10, 0x33, 0x23, 0xCD, 0x3C});
  set(22, {0x00, 0x0C, 0x0A, 0x10, 0x00, 0x28, 0xFF, 0x37});
  set(30, {0x00, 0x00, 0x00, 0x10, 0x00, 0x20, 0x00, 0x30});
  set(0xBB, {51, 49, 45, 0xFE, 0xFF, 0x10, 0x0E, 0x00, 0x00, 4, 5});
  set(0xC6, {0x92, 0x18, 0x52, 0xD6});
  set(0xCA, {1, 1, 99, 20});
  set(0xCE, {'$', 'X', 0, 'Y'});
  const auto packet = parse_position_packet(bytes);
  REQUIRE(packet.has_value());
  CHECK(packet->timestamp_us == 3'595'704'466);
  CHECK(packet->pps == PpsState::kSynchronising);
  CHECK(packet->nmea() == "$X");
  const SensorHealth expected{51, 49, 45, -2, 3600, 4, 5, 1, 99, 20};
  CHECK(packet->health == expected);
  REQUIRE(packet->motion.has_value());
  const auto& boards = *packet->motion;
  CHECK(boards[0].gyro_rad_s == Approx(1024 * 0.09766 * nilio::kRadiansPerDegree));
  CHECK(boards[1].gyro_rad_s == Approx(-1024 * 0.09766 * nilio::kRadiansPerDegree));
  CHECK(boards[0].temperature_degc == Approx(25.0));
  CHECK(boards[1].temperature_degc == Approx(26.453));
  CHECK(boards[0].acceleration_x_m_s2 == Approx(9.80665).epsilon(1e-3));
  CHECK(boards[0].acceleration_y_m_s2 == Approx(-9.80665).epsilon(1e-3));
  CHECK(boards[1].acceleration_x_m_s2 == Approx(-2048 * 0.001221 * 9.80665));
  CHECK(boards[1].acceleration_y_m_s2 == Approx(2047 * 0.001221 * 9.80665));
}

TEST_CASE("the PPS state is unknown where the firmware does not fill its field", "[telemetry]") {
  PositionPacket packet;
  const auto state_of = [&](std::uint8_t byte) {
    auto bytes = encode_position_packet(packet);
    bytes[0xCA] = byte;
    return parse_position_packet(bytes)->pps;
  };
  CHECK(state_of(0) == PpsState::kUnknown);
  CHECK(state_of(2) == PpsState::kLocked);
  CHECK(state_of(4) == PpsState::kUnknown);
  packet.health.top_board_degc = 40;
  CHECK(state_of(0) == PpsState::kAbsent);
  CHECK(state_of(3) == PpsState::kError);
  for (const PpsState pps : {PpsState::kAbsent, PpsState::kSynchronising, PpsState::kLocked, PpsState::kError,
                             PpsState::kUnknown}) {
    packet.pps = pps;
    CHECK(parse_position_packet(encode_position_packet(packet)) == packet);
  }
}

TEST_CASE("values beyond the fields of a position packet are limited, not wrapped", "[telemetry]") {
  PositionPacket packet;
  packet.motion.emplace();
  (*packet.motion)[0] = {1e9, -1e9, 1e9, -1e9};
  packet.set_nmea(std::string(300, 'x'));
  const auto parsed = parse_position_packet(encode_position_packet(packet));
  REQUIRE(parsed->motion.has_value());
  CHECK((*parsed->motion)[0].gyro_rad_s == Approx(2047 * 0.09766 * nilio::kRadiansPerDegree));
  CHECK((*parsed->motion)[0].acceleration_y_m_s2 == Approx(-2048 * 0.001221 * 9.80665));
  CHECK(parsed->nmea() == std::string(kNmeaCapacity, 'x'));
}

TEST_CASE("an RMC sentence gives time, place and speed", "[telemetry]") {
  // The sentence of many manuals, with its published checksum.
  const std::string text = "$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A";
  for (const std::string& form : {text, text + "\r\n", text.substr(1), text + std::string(9, '\0'),
                                  text.substr(0, text.size() - 1) + "a\r\n"}) {
    const auto fix = parse_nmea(form);
    REQUIRE(fix.has_value());
    CHECK(fix->sentence == NmeaSentence::kRmc);
    CHECK(fix->valid);
    CHECK(fix->utc->ns == 764'426'119 * kSecondNs);
    CHECK(fix->latitude_deg == Approx(48.0 + 7.038 / 60.0));
    CHECK(fix->longitude_deg == Approx(11.0 + 31.0 / 60.0));
    CHECK(fix->speed_m_s == Approx(22.4 * 1852.0 / 3600.0));
    CHECK(fix->course_deg == Approx(84.4));
    CHECK_FALSE(fix->altitude_m.has_value());
  }
}

TEST_CASE("a GGA sentence has no date and hence no UTC", "[telemetry]") {
  const auto fix = parse_nmea(sentence("GNGGA,123519.25,4807.038,S,01131.000,W,1,08,0.9,545.4,M,46.9,M,,"));
  REQUIRE(fix.has_value());
  CHECK(fix->sentence == NmeaSentence::kGga);
  CHECK(fix->valid);
  CHECK(fix->time_of_day->ns == (45'319 * std::int64_t{100} + 25) * kSecondNs / 100);
  CHECK_FALSE(fix->utc.has_value());
  CHECK(fix->latitude_deg == Approx(-(48.0 + 7.038 / 60.0)));
  CHECK(fix->longitude_deg == Approx(-(11.0 + 31.0 / 60.0)));
  CHECK(fix->altitude_m == Approx(545.4));
  CHECK_FALSE(parse_nmea(sentence("GPGGA,123519,,,,,0,,,,M,,M,,"))->valid);
}

TEST_CASE("empty fields are absent, not zero", "[telemetry]") {
  const auto fix = parse_nmea(sentence("GPRMC,,V,,,,,,,,,,N"));
  REQUIRE(fix.has_value());
  CHECK_FALSE(fix->valid);
  CHECK_FALSE(fix->time_of_day.has_value());
  CHECK_FALSE(fix->utc.has_value());
  CHECK_FALSE(fix->latitude_deg.has_value());
  CHECK_FALSE(fix->speed_m_s.has_value());
  CHECK_FALSE(parse_nmea(sentence("GPRMC,081802.00,V,,,,,,,,,,N"))->utc.has_value());
}

TEST_CASE("a sentence with any byte changed is rejected", "[telemetry]") {
  const std::string good = sentence("GPRMC,123519.5,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W");
  REQUIRE(parse_nmea(good).has_value());
  // Except '$' and the line end, which are optional.
  for (std::size_t at = 1; at + 2 < good.size(); ++at) {
    for (int bit = 0; bit < 8; ++bit) {
      std::string bad = good;
      bad[at] = static_cast<char>(bad[at] ^ (1 << bit));
      // Checksum digits may be written in lower case.
      if (std::tolower(bad[at]) == std::tolower(good[at]) && at + 4 >= good.size()) continue;
      CHECK_FALSE(parse_nmea(bad).has_value());
    }
  }
  for (std::size_t size = 0; size + 2 < good.size(); ++size) {
    CHECK_FALSE(parse_nmea(good.substr(0, size)).has_value());
  }
}

TEST_CASE("sentences with invalid fields are rejected although the checksum is correct", "[telemetry]") {
  for (const char* body : {
           "GPRMC,123519,X,4807.038,N,01131.000,E,022.4,084.4,230394,,",
           "GPRMC,243519,A,,,,,,,230394,,",
           "GPRMC,126019,A,,,,,,,230394,,",
           "GPRMC,12351,A,,,,,,,230394,,",
           "GPRMC,1235190,A,,,,,,,230394,,",
           "GPRMC,123519,A,,,,,,,310294,,",
           "GPRMC,123519,A,,,,,,,000194,,",
           "GPRMC,123519,A,,,,,,,2303940,,",
           "GPRMC,123519,A,9100.0,N,,,,,230394,,",
           "GPRMC,123519,A,4860.0,N,,,,,230394,,",
           "GPRMC,123519,A,4807.038,E,,,,,230394,,",
           "GPRMC,123519,A,,,,,nan,,230394,,",
           "GPRMC,123519,A,,,,,1e1,,230394,,",
           "GPRMC,123519,A,,,,,-1,,230394,,",
           "GPRMC,123519,A,,,,,1.2.3,,230394,,",
           "GPRMC,123519,A,,,",
           "GPGSV,1,1,00",
           "PGRMC,1,2,3,4,5,6,7,8,9,10,11",
           "",
       }) {
    INFO(body);
    CHECK_FALSE(parse_nmea(sentence(body)).has_value());
  }
}

TEST_CASE("a date 1024 weeks back is corrected to the host's, any other difference is kept", "[telemetry]") {
  const std::int64_t host_ns = kStationaryS * kSecondNs;
  const core::Time host{host_ns};
  // 1024 weeks before 2016-01-21, and that day.
  for (const auto& [date, eras] : {std::pair{"060696", 1}, std::pair{"210116", 0}}) {
    const std::string text = sentence(std::string("GPRMC,081802.00,A,,,,,,,") + date + ",,,A");
    const auto fix = parse_nmea(text, host);
    REQUIRE(fix.has_value());
    CHECK(fix->utc->ns == host_ns);
    CHECK(fix->week_rollover_corrected == (eras > 0));
    CHECK(parse_nmea(text)->utc->ns == host_ns - eras * 1024 * kWeekNs);
    // A host clock that is off by a year does not change the receiver's date.
    const core::Time wrong_host{host_ns + 52 * kWeekNs};
    CHECK(parse_nmea(text, wrong_host)->utc->ns == host_ns - eras * 1024 * kWeekNs);
  }
  const std::string future = sentence("GPRMC,081802.00,A,,,,,,,210116,,,A");
  CHECK(parse_nmea(future, core::Time{host_ns + 2048 * kWeekNs + 3600 * kSecondNs})->utc->ns ==
        host_ns + 2048 * kWeekNs);
  CHECK(parse_nmea(future, core::Time{0})->utc->ns == host_ns);
}
