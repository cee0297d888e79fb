#include "nilio/drivers/velodyne/hdl64e/status.hpp"

#include "tests/support/hdl64e_support.hpp"

#include <string>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using namespace nilio::tests;

TEST_CASE("the loss of any packet never gives a wrong table, and the next pass succeeds", "[hdl64e_stream]") {
  const Hdl64eStatusWriter writer = make_writer();
  const auto stream = one_pass(writer);
  for (std::size_t lost = 0; lost < kHdl64eStatusPackets; ++lost) {
    Hdl64eStatusReader reader;
    feed(reader, std::span(stream).first(lost));
    feed(reader, std::span(stream).subspan(lost + 1));
    REQUIRE_FALSE(reader.calibration().has_value());
    feed(reader, stream);
    REQUIRE(reader.calibration().has_value());
    REQUIRE(*reader.calibration() == writer.calibration());
    // Before the first 'H' a gap is not detectable.
    REQUIRE(reader.counters().gaps == (lost == 0 ? 0 : 1));
  }
}

TEST_CASE("losses of complete cycles never give a wrong table", "[hdl64e_stream]") {
  const Hdl64eStatusWriter writer = make_writer();
  const auto stream = one_pass(writer);
  for (const std::size_t cycles : {1U, 2U, 3U, 4U, 8U, 64U, 259U}) {
    for (std::size_t first = 0; first + cycles <= kHdl64eStatusCycles; ++first) {
      Hdl64eStatusReader reader;
      feed(reader, std::span(stream).first(first * 16 + 5));
      feed(reader, std::span(stream).subspan(std::min((first + cycles) * 16 + 5, stream.size())));
      CHECK_FALSE(reader.calibration().has_value());
      feed(reader, stream);
      feed(reader, stream);
      REQUIRE(reader.calibration().has_value());
      REQUIRE(*reader.calibration() == writer.calibration());
    }
  }
}

TEST_CASE("repeated or swapped packets restart the table", "[hdl64e_stream]") {
  const Hdl64eStatusWriter writer = make_writer();
  const auto stream = one_pass(writer);
  for (std::size_t at = 1; at + 2 < stream.size(); at += 11) {
    auto repeated = stream;
    repeated.insert(repeated.begin() + static_cast<std::ptrdiff_t>(at), repeated[at]);
    auto swapped = stream;
    std::swap(swapped[at], swapped[at + 1]);
    for (const auto& bad : {repeated, swapped}) {
      Hdl64eStatusReader reader;
      feed(reader, bad);
      CHECK_FALSE(reader.calibration().has_value());
      CHECK(reader.counters().gaps >= 1);
      feed(reader, stream);
      REQUIRE(reader.calibration().has_value());
      REQUIRE(*reader.calibration() == writer.calibration());
    }
  }
}

TEST_CASE("a loss reported by the caller restarts the table", "[hdl64e_stream]") {
  const auto stream = one_pass(make_writer());
  Hdl64eStatusReader reader;
  reader.note_loss();
  CHECK(reader.counters().gaps == 0);
  feed(reader, std::span(stream).first(2000));
  reader.note_loss();
  CHECK(reader.counters().gaps == 1);
  feed(reader, std::span(stream).subspan(2000));
  CHECK_FALSE(reader.calibration().has_value());
  feed(reader, stream);
  CHECK(reader.calibration().has_value());
}

TEST_CASE("a change of any calibration byte is detected", "[hdl64e_stream]") {
  const auto stream = one_pass(make_writer());
  for (std::size_t laser = 0; laser < kHdl64eLasers; ++laser) {
    for (std::size_t i = 0; i < 21; ++i) {
      for (const int flip : {0x01, 0x02, 0x04, 0x08, 0x10, 0x20, 0x40, 0x80, 0xFF, 0x5A}) {
        auto bad = stream;
        std::uint8_t& value = bad[packet_of_laser(laser, i)].value;
        value = static_cast<std::uint8_t>(value ^ flip);
        Hdl64eStatusReader reader;
        feed(reader, bad);
        REQUIRE_FALSE(reader.calibration().has_value());
        // A wrong id counts as a cycle out of order.
        REQUIRE(reader.counters().wrong_crc == (i == 0 ? 0 : 1));
        REQUIRE(reader.counters().gaps == (i == 0 ? 1 : 0));
      }
    }
  }
}

TEST_CASE("a wrong CRC is counted and the next pass is read", "[hdl64e_stream]") {
  const auto stream = one_pass(make_writer());
  for (const std::size_t place : {5U, 6U}) {
    auto bad = stream;
    bad[packet_of(259, place)].value ^= 0x10;
    Hdl64eStatusReader reader;
    feed(reader, bad);
    CHECK_FALSE(reader.calibration().has_value());
    CHECK(reader.counters().wrong_crc == 1);
    feed(reader, stream);
    CHECK(reader.calibration().has_value());
    // The good table remains when a later pass is bad.
    feed(reader, bad);
    CHECK(reader.calibration().has_value());
    CHECK(reader.counters().wrong_crc == 2);
    CHECK(reader.counters().tables == 1);
  }
}

TEST_CASE("random bytes give no table", "[hdl64e_stream]") {
  Hdl64eStatusReader reader;
  std::uint32_t state = 7;
  const std::string types = "HMSDNYGTV1234567W";
  for (int i = 0; i < 500'000; ++i) {
    state = state * 1'664'525 + 1'013'904'223;
    // Includes the factory bytes of another model.
    const auto type =
        i % 1000 < 500 ? static_cast<std::uint8_t>(types[(state >> 8) % types.size()]) : std::uint8_t{0x37};
    reader.add(type, static_cast<std::uint8_t>(state >> 24));
  }
  CHECK_FALSE(reader.calibration().has_value());
  CHECK(reader.counters().tables == 0);
}
