#include "nilio/drivers/velodyne/hdl64e/status.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tests/support/hdl64e_support.hpp"
#include "tests/support/paths.hpp"

#include <array>
#include <string>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using namespace nilio::tests;
using Catch::Matchers::Contains;

namespace {

constexpr std::int64_t kSecondNs = 1'000'000'000;

}  // namespace

TEST_CASE("the CRC of the status stream is that of the manual", "[hdl64e_status]") {
  const std::string digits = "123456789";
  CHECK(hdl64e_crc(std::vector<std::uint8_t>(digits.begin(), digits.end())) == 0xFEE8);
  CHECK(hdl64e_crc(std::vector<std::uint8_t>{0x06, 0x07}) == 0x9411);
  CHECK(hdl64e_crc(std::vector<std::uint8_t>{0xF1, 0x0B, 0xF0, 0x24, 0x78}) == 0x6328);
  // The manual's example of three lasers: words with the high byte first.
  const std::vector<std::uint8_t> lasers{
      0xFE, 0x7B, 0xFD, 0x27, 0x05, 0x0E, 0x05, 0x53, 0x05, 0x36, 0x00, 0xC5, 0x00, 0x19, 0x36,
      0xB0, 0x00, 0x0A, 0x00, 0xFF, 0xFF, 0x51, 0xFD, 0x44, 0x04, 0xF6, 0x05, 0x50, 0x05, 0x42,
      0x00, 0xC5, 0xFF, 0xE6, 0x23, 0x28, 0x00, 0x0F, 0x00, 0xFF, 0x01, 0x8F, 0x00, 0x06, 0x04,
      0x9B, 0x04, 0xF4, 0x04, 0xB7, 0x00, 0xCE, 0x00, 0x19, 0x2E, 0xE0, 0x00, 0x14, 0x14, 0xFF};
  CHECK(hdl64e_crc(lasers) == 0xA542);
}

TEST_CASE("the status stream has the manual's types and bytes at the manual's places", "[hdl64e_status]") {
  std::vector<LaserCalibration> lasers = some_lasers();
  // The first laser of the manual's CRC example.
  LaserCalibration& laser = lasers[5];
  laser.elevation_rad = -3.89 * nilio::kRadiansPerDegree;
  laser.azimuth_correction_rad = -7.29 * nilio::kRadiansPerDegree;
  laser.distance_correction_m = 1.294;
  laser.near_distance_correction_x_m = 1.363;
  laser.near_distance_correction_y_m = 1.334;
  laser.vertical_offset_m = 0.197;
  laser.horizontal_offset_m = 0.025;
  laser.focal_distance_m = 14.0;
  laser.focal_slope = 1.0;
  laser.min_intensity = 0;
  laser.max_intensity = 255;
  const auto stream = one_pass(Hdl64eStatusWriter::create(lasers, some_unit()).value());
  const std::array<std::uint8_t, 21> expected{5,    0x7B, 0xFE, 0x27, 0xFD, 0x0E, 0x05,
                                              0x53, 0x05, 0x36, 0x05, 0xC5, 0x00, 0x19,
                                              0x00, 0xB0, 0x36, 0x0A, 0x00, 0x00, 0xFF};
  for (std::size_t i = 0; i < expected.size(); ++i) {
    CHECK(int{stream[packet_of_laser(5, i)].value} == int{expected[i]});
    CHECK(stream[packet_of_laser(5, i)].type == '1' + i % 7);
  }
  const std::string head = "HMSDNYGTV12345\xF7\xF6";
  const std::string values = std::string("\x16\x0D\x14\x0E\x0B\x17") + "A\x29\x47UNIT#\x1F\x1D";
  for (std::size_t i = 0; i < 16; ++i) {
    CHECK(stream[i].type == static_cast<std::uint8_t>(head[i]));
    CHECK(stream[i].value == static_cast<std::uint8_t>(values[i]));
  }
  CHECK(stream[packet_of(4, 0)] == Hdl64eStatusByte{'W', some_readings().warnings});
  CHECK(stream[packet_of(252, 0)].type == 'W');
  CHECK(stream[packet_of(256, 0)] == Hdl64eStatusByte{'1', 23});
  CHECK(stream[packet_of(256, 6)] == Hdl64eStatusByte{'7', 40});
  CHECK(stream[packet_of(257, 0)] == Hdl64eStatusByte{0xFE, 600 & 0xFF});
  CHECK(stream[packet_of(257, 1)] == Hdl64eStatusByte{0xFF, 600 >> 8});
  CHECK(stream[packet_of(257, 2)] == Hdl64eStatusByte{0xFC, 100});
  CHECK(stream[packet_of(257, 5)] == Hdl64eStatusByte{0xFB, 35'900 >> 8});
  CHECK(stream[packet_of(257, 6)] == Hdl64eStatusByte{'7', 1234 & 0xFF});
  CHECK(stream[packet_of(258, 0)] == Hdl64eStatusByte{'1', 1234 >> 8});
  CHECK(stream[packet_of(258, 1)] == Hdl64eStatusByte{'2', 192});
  CHECK(stream[packet_of(259, 1)] == Hdl64eStatusByte{'2', 3});
  CHECK(stream[packet_of(259, 2)] == Hdl64eStatusByte{0xF9, 2});
  CHECK(stream[packet_of(259, 4)] == Hdl64eStatusByte{0xF8, 0xA8});
}

TEST_CASE("a reader that joins at any packet receives the data of the writer", "[hdl64e_status]") {
  const Hdl64eStatusWriter writer = make_writer();
  const auto stream = one_pass(writer);
  for (std::size_t start = 0; start < kHdl64eStatusPackets; start += 7) {
    Hdl64eStatusReader reader;
    feed(reader, std::span(stream).subspan(start));
    CHECK(reader.calibration().has_value() == (start == 0));
    feed(reader, stream);
    REQUIRE(reader.calibration().has_value());
    CHECK(*reader.calibration() == writer.calibration());
    CHECK(*reader.readings() == some_readings());
    CHECK(reader.counters().gaps == 0);
    CHECK(reader.counters().tables == (start == 0 ? 2 : 1));
  }
  CHECK(writer.calibration().unit == some_unit());
  CHECK(writer.calibration().checksum == Hdl64eChecksum::kCrc);
}

TEST_CASE("a calibration loses at most half a step of the stream", "[hdl64e_status]") {
  const Hdl64eStatusWriter writer = make_writer();
  const std::vector<LaserCalibration> lasers = some_lasers();
  for (std::size_t id = 0; id < lasers.size(); ++id) {
    const LaserCalibration& sent = lasers[id];
    const LaserCalibration& got = writer.calibration().lasers[id];
    CHECK(got.elevation_rad == Approx(sent.elevation_rad).margin(0.0051 * nilio::kRadiansPerDegree));
    CHECK(got.azimuth_correction_rad ==
          Approx(sent.azimuth_correction_rad).margin(0.0051 * nilio::kRadiansPerDegree));
    CHECK(got.distance_correction_m == Approx(sent.distance_correction_m).margin(0.00051));
    CHECK(got.near_distance_correction_y_m == Approx(sent.near_distance_correction_y_m).margin(0.00051));
    CHECK(got.focal_distance_m == Approx(sent.focal_distance_m).margin(0.00051));
    CHECK(got.focal_slope == Approx(sent.focal_slope).margin(0.051));
    CHECK(got.min_intensity == sent.min_intensity);
    CHECK(got.max_intensity == sent.max_intensity);
  }
  const auto again = Hdl64eStatusWriter::create(writer.calibration().lasers, some_unit());
  CHECK(again->calibration() == writer.calibration());
}

TEST_CASE("the CRC covers the lasers with high bytes first; a CRC over the bytes as sent is also accepted",
          "[hdl64e_status]") {
  auto stream = one_pass(make_writer());
  std::vector<std::uint8_t> as_sent;
  std::vector<std::uint8_t> high_first;
  for (std::size_t laser = 0; laser < kHdl64eLasers; ++laser) {
    const auto byte = [&](std::size_t i) { return stream[packet_of_laser(laser, i)].value; };
    for (std::size_t i = 1; i < 21; ++i) {
      as_sent.push_back(byte(i));
      // Nine words, then two single bytes.
      high_first.push_back(byte(i > 18 ? i : i % 2 == 1 ? i + 1 : i - 1));
    }
  }
  std::uint8_t& low = stream[packet_of(259, 5)].value;
  std::uint8_t& high = stream[packet_of(259, 6)].value;
  CHECK(low + 256 * high == hdl64e_crc(high_first));
  const std::uint16_t crc = hdl64e_crc(as_sent);
  REQUIRE(crc != hdl64e_crc(high_first));
  low = static_cast<std::uint8_t>(crc & 0xFF);
  high = static_cast<std::uint8_t>(crc >> 8);
  Hdl64eStatusReader reader;
  feed(reader, stream);
  REQUIRE(reader.calibration().has_value());
  CHECK(reader.calibration()->checksum == Hdl64eChecksum::kCrc);
}

TEST_CASE("a table with 1820 in place of a CRC is accepted and reported as without CRC", "[hdl64e_status]") {
  const Hdl64eStatusWriter writer = make_writer(Hdl64eChecksum::kNone);
  auto stream = one_pass(writer);
  CHECK(stream[packet_of(259, 5)].value == (1820 & 0xFF));
  CHECK(stream[packet_of(259, 6)].value == 1820 >> 8);
  // Plain digits as types, as older firmware may send.
  for (std::size_t i = 0; i < stream.size(); ++i) {
    if (i % 16 >= 9) stream[i].type = static_cast<std::uint8_t>('1' + (i % 16 - 9));
  }
  Hdl64eStatusReader reader;
  feed(reader, stream);
  REQUIRE(reader.calibration().has_value());
  CHECK(reader.calibration()->checksum == Hdl64eChecksum::kNone);
  CHECK(*reader.calibration() == writer.calibration());

  auto bad = stream;
  bad[packet_of_laser(20, 2)].value = 0x7F;
  Hdl64eStatusReader other;
  feed(other, bad);
  CHECK_FALSE(other.calibration().has_value());
  CHECK(other.counters().implausible == 1);
}

TEST_CASE("implausible focus values are left unknown", "[hdl64e_status]") {
  auto stream = one_pass(make_writer(Hdl64eChecksum::kNone));
  stream[packet_of_laser(8, 18)].value = 0x40;
  stream[packet_of_laser(9, 19)].value = 200;
  stream[packet_of_laser(9, 20)].value = 100;
  Hdl64eStatusReader reader;
  feed(reader, stream);
  REQUIRE(reader.calibration().has_value());
  const auto& lasers = reader.calibration()->lasers;
  CHECK(lasers[8].focal_distance_m == 0.0);
  CHECK(lasers[8].focal_slope == 0.0);
  CHECK(lasers[9].focal_slope > 0.0);
  CHECK(int{lasers[9].min_intensity} == 0);
  CHECK(int{lasers[9].max_intensity} == 255);
}

TEST_CASE("the clock of the stream advances and never shows an invalid time", "[hdl64e_status]") {
  // 22:59:58 to 23:00:02, 20 cycles a second; the sensor updates its clock during a cycle. With every shift
  // the hour ends before another packet of a cycle.
  for (std::int64_t shift = 0; shift < 16; ++shift) {
    Hdl64eStatusWriter writer = make_writer();
    Hdl64eStatusReader reader;
    const std::int64_t start = kEpochNs + (46 * 60 + 38) * kSecondNs - (2 * shift + 1) * kSecondNs / 640;
    std::int64_t latest = 0;
    std::size_t seconds_seen = 0;
    for (std::int64_t packet = 0; packet < 16 * 92; ++packet) {
      Hdl64eStatusByte byte = writer.next(some_readings());
      const std::int64_t time = start + packet * kSecondNs / 320;
      const std::int64_t of_day = time / kSecondNs % 86'400;
      if (byte.type == 'H') byte.value = static_cast<std::uint8_t>(of_day / 3600);
      if (byte.type == 'M') byte.value = static_cast<std::uint8_t>(of_day / 60 % 60);
      if (byte.type == 'S') byte.value = static_cast<std::uint8_t>(of_day % 60);
      reader.add(byte.type, byte.value);
      if (!reader.readings() || !reader.readings()->clock) continue;
      const std::int64_t shown = reader.readings()->clock->ns;
      CHECK(shown >= latest);
      CHECK(shown <= time);
      CHECK(shown > time - 2 * kSecondNs);
      if (shown > latest) ++seconds_seen;
      latest = shown;
    }
    CHECK(latest == kEpochNs + (46 * 60 + 38 + 4) * kSecondNs);
    CHECK(seconds_seen >= 5);
  }
}

TEST_CASE("the readings of every cycle are those of its sensor", "[hdl64e_status]") {
  Hdl64eStatusWriter writer = make_writer();
  for (const Hdl64eGps gps : {Hdl64eGps::kNone, Hdl64eGps::kPulseAndTime, Hdl64eGps::kTimeOnly,
                              Hdl64eGps::kPulseOnly, Hdl64eGps::kUnknown}) {
    Hdl64eStatusReader reader;
    const Hdl64eReadings now{core::Time{kEpochNs}, gps, 60, 0x52, kHdl64eTooHot};
    for (std::size_t i = 0; i < 32; ++i) {
      const Hdl64eStatusByte byte = writer.next(now);
      reader.add(byte.type, byte.value);
      CHECK(reader.readings().has_value() == (i >= 8));
    }
    CHECK(reader.readings()->gps == gps);
    CHECK(reader.readings()->clock == core::Time{kEpochNs});
    CHECK(int{reader.readings()->temperature_degc} == 60);
    CHECK(int{reader.readings()->firmware} == 0x52);
  }
  // 31 February is an invalid date.
  Hdl64eStatusReader reader;
  for (int cycle = 0; cycle < 3; ++cycle) {
    for (const auto& [type, value] : {std::pair{'H', 1},
                                      {'M', 1},
                                      {'S', 1},
                                      {'D', 31},
                                      {'N', 2},
                                      {'Y', 20},
                                      {'G', 0},
                                      {'T', 20},
                                      {'V', 1}}) {
      reader.add(static_cast<std::uint8_t>(type), static_cast<std::uint8_t>(value));
    }
    for (std::uint8_t i = 0; i < 7; ++i) reader.add(static_cast<std::uint8_t>('1' + i), 0);
  }
  CHECK(reader.counters().cycles == 3);
  CHECK_FALSE(reader.readings()->clock.has_value());
}

TEST_CASE("a calibration from the stream can be saved and loaded exactly", "[hdl64e_status]") {
  NILIO_REQUIRE_DATA(folder, "velodyne/golden");
  for (const char* name : {"HDL64e_s2.yaml", "HDL64e_s3.yaml"}) {
    const VelodyneSensor model = make_velodyne_sensor(VelodyneModel::kHdl64eS2);
    const auto unit = with_calibration_file(model, (folder / name).string());
    REQUIRE(unit.ok());
    const auto writer = Hdl64eStatusWriter::create(unit->lasers, some_unit());
    REQUIRE(writer.ok());
    Hdl64eStatusReader reader;
    feed(reader, one_pass(*writer));
    REQUIRE(reader.calibration().has_value());
    const auto sensor = with_stream_calibration(model, *reader.calibration());
    REQUIRE(sensor.ok());
    const TemporaryFile saved("", ".yaml");
    REQUIRE(write_calibration_yaml(*sensor, saved.path()).ok());
    const auto loaded = with_calibration_file(model, saved.path());
    REQUIRE(loaded.ok());
    CHECK(loaded->lasers == sensor->lasers);
    CHECK(loaded->beam_spacing_rad == sensor->beam_spacing_rad);
    for (std::size_t id = 0; id < kHdl64eLasers; ++id) {
      CHECK(loaded->lasers[id].elevation_rad ==
            Approx(unit->lasers[id].elevation_rad).margin(0.0051 * nilio::kRadiansPerDegree));
    }
  }
}

TEST_CASE("values that do not fit the stream are rejected", "[hdl64e_status]") {
  std::vector<LaserCalibration> lasers = some_lasers();
  lasers[7].focal_distance_m = 40.0;
  const auto too_far = Hdl64eStatusWriter::create(lasers, some_unit());
  REQUIRE_FALSE(too_far.ok());
  CHECK_THAT(too_far.error().message, Contains("laser 7") && Contains("16 bits"));
  lasers = some_lasers();
  lasers[3].vertical_offset_m = 20.0;
  CHECK_FALSE(Hdl64eStatusWriter::create(lasers, some_unit()).ok());
  lasers.resize(16);
  const auto too_few = Hdl64eStatusWriter::create(lasers, some_unit());
  REQUIRE_FALSE(too_few.ok());
  CHECK_THAT(too_few.error().message, Contains("16 lasers, expected 64"));
  const auto vlp16 =
      with_stream_calibration(make_velodyne_sensor(VelodyneModel::kVlp16), make_writer().calibration());
  REQUIRE_FALSE(vlp16.ok());
  CHECK_THAT(vlp16.error().message, Contains("VLP-16") && Contains("16 lasers"));
}
