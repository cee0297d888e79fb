#include "nilio/drivers/can/can_files.hpp"

#include "tests/support/can_contents.hpp"
#include "tests/support/paths.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using namespace nilio::tests;
using Catch::Matchers::Contains;

TEST_CASE("a candump line is read exactly", "[candump]") {
  const auto line = parse_candump_line("(1700000000.123456) can0 034#0000000009CF\n");
  REQUIRE(line.has_value());
  CHECK(line->frame.stamp.ns == 1700000000123456000);
  CHECK(line->interface_name == "can0");
  CHECK(line->frame.id == 0x34);
  CHECK(line->frame.length == 6);
  CHECK(line->frame.data[5] == 0xCF);
  CHECK_FALSE(line->frame.extended);
}

TEST_CASE("the dialects of candump are parsed", "[candump]") {
  CHECK(parse_candump_line("(1.123456789) can0 123#11 R")->frame.stamp.ns == 1123456789);
  CHECK(parse_candump_line("(46408.584930) vcan1 1F334455#1122 T\r\n")->frame.extended);
  CHECK(parse_candump_line("(1.0) can0 7FF#")->frame.length == 0);
  CHECK(parse_candump_line("(1.5) can0 123#11.22.33")->frame.length == 3);
  const auto remote = parse_candump_line("(1.000000) can0 123#R8");
  REQUIRE(remote.has_value());
  CHECK(remote->frame.remote);
  CHECK(remote->frame.length == 8);
  CHECK(parse_candump_line("(1.000000) can0 123#R")->frame.length == 0);
  CHECK(parse_candump_line("(1.000000) can0 123#1122334455667788_E")->frame.length == 8);
  const auto error = parse_candump_line("(1.000000) can0 20000004#0004000000000000");
  REQUIRE(error.has_value());
  CHECK(error->frame.error);
  CHECK(error->frame.id == 4);
  const auto wide = parse_candump_line("(1.000000) can0 123##1" + std::string(128, 'A'));
  REQUIRE(wide.has_value());
  CHECK(wide->frame.flexible_data_rate);
  CHECK(wide->frame.length == 64);
}

TEST_CASE("broken candump lines are rejected", "[candump]") {
  for (const char* line : {"",
                           "(",
                           "()",
                           "(1.0)",
                           "(1.0) can0",
                           "(1.0) can0 123",
                           "(1.0) can0 12#11",
                           "(1.0) can0 123#1",
                           "(1.0) can0 123#GG",
                           "(1.0) can0 123#112233445566778899",
                           "(x.0) can0 123#11",
                           "(1.0 can0 123#11",
                           "(1) can0 123#11",
                           "(1.) can0 123#11",
                           "(1.0) can0 800#11",
                           "(1.0) can0 FFFFFFFF#11",
                           "(1.0) can0 123#11 X",
                           "(1.0) can0 123#11 R more",
                           "(1.0) can0 123##",
                           "(99999999999999999999.0) can0 1#11",
                           "(9999999999.0) can0 123#11",
                           "(1.1234567890) can0 123#11",
                           "(1.0) can0 123#R9",
                           "(-1.0) can0 123#11",
                           "(1.0) can0 123#11."}) {
    CAPTURE(line);
    CHECK_FALSE(parse_candump_line(line).has_value());
  }
}

TEST_CASE("formatting a frame and parsing it again gives the same frame", "[candump]") {
  CanFrame frame;
  frame.id = 0x123;
  frame.length = 3;
  frame.data = {1, 2, 0xFF};
  frame.stamp.ns = 1700000000123456000;
  CHECK(format_candump_line(frame, "can0") == "(1700000000.123456) can0 123#0102FF");
  frame.stamp.ns += 789;
  frame.extended = true;
  CHECK(format_candump_line(frame, "can0") == "(1700000000.123456789) can0 00000123#0102FF");
  CHECK(parse_candump_line(format_candump_line(frame, "can0"))->frame.stamp == frame.stamp);
  frame.flexible_data_rate = true;
  frame.length = 64;
  const auto wide = parse_candump_line(format_candump_line(frame, "can0"));
  REQUIRE(wide.has_value());
  CHECK(wide->frame.flexible_data_rate);
  CHECK(wide->frame.data == frame.data);
  CanFrame remote;
  remote.id = 5;
  remote.remote = true;
  remote.length = 4;
  CHECK(parse_candump_line(format_candump_line(remote, "can0"))->frame.length == 4);
  CanFrame error;
  error.id = 4;
  error.error = true;
  error.length = 8;
  CHECK(parse_candump_line(format_candump_line(error, "can0"))->frame.error);
}

TEST_CASE("a log with comments, broken lines and other interfaces gives the selected frames", "[candump]") {
  const TemporaryFile file(
      "# a comment\n\n(1.000000) can0 032#01\n(1.0005\n(1.001000) can1 032#02\n(1.002000) can0 0zz#03\n" +
          std::string(2000, '(') + "\n(1.003000) can0 034#04",
      ".log");
  const CanContents contents = contents_of(open_candump(file.path(), "can0"));
  REQUIRE(contents.frames.size() == 2);
  CHECK(contents.frames[1].data[0] == 4);
  CHECK(contents.frames[1].received_ns > 0);
  CHECK(contents.state == SourceState::kEnd);
  CHECK(contents.stats.malformed == 3);
  CHECK(contents.stats.other == 1);
  CHECK_THAT(contents.status, Contains("3 broken lines, first line 4: '(1.0005'") && Contains("can1"));
  CHECK(contents_of(open_candump(file.path(), "")).frames.size() == 3);
}

TEST_CASE("status() of a log without frames gives the expected format", "[candump]") {
  const TemporaryFile text("hello\nworld\n", ".log");
  CHECK_THAT(contents_of(open_candump(text.path(), "")).status,
             Contains("0 frames") && Contains("candump -L"));
  const TemporaryFile other("(1.0) can1 123#11\n", ".log");
  CHECK_THAT(contents_of(open_candump(other.path(), "can0")).status, Contains("can1") && Contains("'can0'"));
  CHECK_THAT(open_candump("/nonexistent.log", "").error().message,
             Contains("/nonexistent.log") && Contains("No such file"));
  CHECK_THAT(open_candump("/", "").error().message, Contains("folder"));
}

TEST_CASE("a minute of a real car's bus is read without a broken line", "[candump]") {
  NILIO_REQUIRE_DATA(archive, "can/toyota_rav4_60s_candump.log.xz");
  const TemporaryFile log("", ".log");
  const std::string command = "xz -dc '" + archive.string() + "' > '" + log.path() + "'";
  REQUIRE(std::system(command.c_str()) == 0);
  const CanContents contents = contents_of(open_candump(log.path(), ""));
  CHECK(contents.frames.size() == 98800);
  CHECK(contents.stats.malformed == 0);
  const auto kinematics = std::count_if(contents.frames.begin(), contents.frames.end(),
                                        [](const CanFrame& frame) { return frame.id == 0x24; });
  CHECK(static_cast<double>(kinematics) / 60.0 == Approx(82.9).margin(1.5));
}
