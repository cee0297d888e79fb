// Logs in other forms than that of candump -L.

#include "nilio/drivers/can/can_files.hpp"

#include "tests/support/can_contents.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using namespace nilio::tests;
using Catch::Matchers::Contains;

namespace {

std::vector<std::int64_t> stamps_of(const CanContents& contents) {
  std::vector<std::int64_t> stamps;
  for (const CanFrame& frame : contents.frames) stamps.push_back(frame.stamp.ns);
  return stamps;
}

using Stamps = std::vector<std::int64_t>;

}  // namespace

TEST_CASE("candump's terminal output is read with its absolute times", "[candump_forms]") {
  const CanContents contents = read_can_log(
      " (1700000000.123456)  can0  034   [6]  00 00 00 00 09 CF\n"
      " (1700000000.223456)  can0  1ABCDEF0   [2]  01 02   '..'\n"
      " (1700000000.323456)  can1  123   [0]  remote request\n"
      " (1700000000.423456)  can0  123   [4]  remote request\n"
      " (1700000000.523456)  can0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME\n"
      " (1700000000.623456)  can0  RX - -  124  [12]  01 02 03 04 05 06 07 08 09 0A 0B 0C\n"
      " (1700000000.723456)  can0  TX B E  7FF  [01]  FF\n");
  CHECK(contents.stats.malformed == 0);
  REQUIRE(contents.frames.size() == 7);
  const std::vector<CanFrame>& frames = contents.frames;
  CHECK(frames[0].stamp.ns == 1700000000123456000);
  CHECK(frames[0].id == 0x34);
  CHECK(frames[0].length == 6);
  CHECK(frames[0].data[5] == 0xCF);
  CHECK(frames[1].extended);
  CHECK(frames[1].data[1] == 2);
  CHECK(frames[2].remote);
  CHECK(frames[3].remote);
  CHECK(frames[3].length == 4);
  CHECK(frames[4].error);
  CHECK(frames[4].id == 4);
  CHECK(frames[5].flexible_data_rate);
  CHECK(frames[5].length == 12);
  CHECK(frames[6].flexible_data_rate);
  CHECK(frames[6].data[0] == 0xFF);
}

TEST_CASE("time differences are added up, times since the first frame are not", "[candump_forms]") {
  const auto line = [](const char* stamp) { return std::string(" (") + stamp + ")  can0  001   [1]  00\n"; };
  const CanContents steps =
      read_can_log(line("000.000000") + line("000.010000") + line("000.009000") + line("001.500000"));
  CHECK(stamps_of(steps) == Stamps{0, 10'000'000, 19'000'000, 1'519'000'000});
  const CanContents times =
      read_can_log(line("000.000000") + line("000.010000") + line("000.019000") + line("001.500000"));
  CHECK(stamps_of(times) == Stamps{0, 10'000'000, 19'000'000, 1'500'000'000});
}

TEST_CASE("frames without a time are read, and status() warns about them", "[candump_forms]") {
  const CanContents contents = read_can_log("  can0  034   [6]  00 00 00 00 09 CF\n  can0  035   [0]\n");
  REQUIRE(contents.frames.size() == 2);
  CHECK_THAT(contents.status, Contains("2 frames without a time") && Contains("candump -L"));
}

TEST_CASE("a log is read from a pipe", "[candump_forms]") {
  const TemporaryFile log("(1.0) can0 001#11\n(2.0) can0 002#22\n", ".log");
  const TemporaryFile pipe("", ".fifo");
  const std::string make = "rm '" + pipe.path() + "' && mkfifo '" + pipe.path() + "'";
  REQUIRE(std::system(make.c_str()) == 0);
  const std::string feed = "cat '" + log.path() + "' > '" + pipe.path() + "' &";
  REQUIRE(std::system(feed.c_str()) == 0);
  auto source = open_candump(pipe.path(), "");
  REQUIRE(source.ok());
  std::array<CanFrame, 4> slots;
  CHECK((*source)->read(slots, {}).count == 2);
  CHECK(slots[1].id == 2);
}

TEST_CASE("broken lines of terminal output are counted", "[candump_forms]") {
  for (const char* line :
       {"  can0  034   [6]  00 00 00 00 09", "  can0  034   [9]  00 00 00 00 09 00 00 00 00",
        "  can0  034   [x]  00", "  can0  0034   [1]  00", "  can0  034   [1]  0", "  can0  034   [1]  00 11",
        "  can0  034   [65]  00", " (1.x)  can0  034   [1]  00", "  can0  034   [4]  remote"}) {
    CAPTURE(line);
    const CanContents contents = read_can_log(std::string(line) + "\n");
    CHECK(contents.frames.empty());
    CHECK(contents.stats.malformed == 1);
  }
  CHECK(read_can_log(" a comment\n  another [1 of 2\n").stats.malformed == 1);
}

TEST_CASE("an ASC log is read as by asc2log", "[candump_forms]") {
  // Output of log2asc.
  const std::string header =
      "date Tue Nov 14 22:13:20 2023\nbase hex  timestamps absolute\nno internal events logged\n";
  const CanContents contents = read_can_log(
      header +
      "// version 8.1.0\nBegin Triggerblock Tue Nov 14 22:13:20 2023\n   0.000000 Start of measurement\n"
      "   0.000000 1  123             Rx   d 3 01 02 FF\n   0.100000 1  1ABCDEF0x       Rx   d 1 01\n"
      "   0.200000 2  123             Rx   r 0\n   1.200000 1  ErrorFrame\n"
      "   1.876549 CANFD   1 Rx        123                                   1 0 9 12 01 02 03 04 05 06 07 "
      "08 09 0A "
      "0B 0C   130000  130     3000 0 0 0 0 0\n"
      "   1.900000 CANFD   2 Tx        7FFx  SomeName  0 0 1 1 AA   130000  130     3000 0 0 0 0 0\n"
      "   1.950000 1  124             Rx   d 8 01 02 03 04 05 06 07 08  Length = 240000 BitCount = 124 ID = "
      "292\n"
      "   2.000000 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%\n   2.1 1  125 Rx d 3 01\n"
      "End TriggerBlock\n");
  REQUIRE(contents.frames.size() == 7);
  CHECK(contents.stats.malformed == 1);
  const std::vector<CanFrame>& frames = contents.frames;
  CHECK(frames[0].stamp.ns == 1'700'000'000'000'000'000);
  CHECK(frames[0].id == 0x123);
  CHECK(frames[0].length == 3);
  CHECK(frames[0].data[2] == 0xFF);
  CHECK(frames[1].extended);
  CHECK(frames[1].id == 0x1ABCDEF0);
  CHECK(frames[1].stamp.ns == 1'700'000'000'100'000'000);
  CHECK(frames[2].remote);
  CHECK(frames[3].error);
  CHECK(frames[4].flexible_data_rate);
  CHECK(frames[4].length == 12);
  CHECK(frames[4].data[11] == 0x0C);
  CHECK(frames[5].extended);
  CHECK(frames[5].data[0] == 0xAA);
  CHECK(frames[6].length == 8);
  CHECK(read_can_log(header + "0.1 1 123 Rx d 1 01\n0.2 2 123 Rx d 1 02\n", "can1").frames.size() == 1);
}

TEST_CASE("ASC logs with decimal numbers, time steps and other date formats are read", "[candump_forms]") {
  const CanContents contents = read_can_log(
      "date Mit Mai 1 10:00:00.250 pm 2024\nbase dec  timestamps relative\n0.5 1 291 Rx d 2 10 255\n"
      "0.25 1 292 Rx d 0\n");
  REQUIRE(contents.frames.size() == 2);
  CHECK(contents.frames[0].id == 0x123);
  CHECK(contents.frames[0].data[1] == 0xFF);
  CHECK(contents.frames[0].stamp.ns == 1'714'600'800'750'000'000);
  CHECK(contents.frames[1].stamp.ns == 1'714'600'801'000'000'000);
  const CanContents dateless = read_can_log("base hex  timestamps absolute\n0.5 1 123 Rx d 0\n");
  CHECK(stamps_of(dateless) == Stamps{500'000'000});
}
