#include "tests/support/tools/record_support.hpp"

#include <algorithm>

#include <catch2/catch.hpp>

using namespace nilio;
using Catch::Matchers::Contains;
using tests::LoopbackSocket;
using tests::NilioProcess;
using tests::numbers_of;
using tests::TemporaryFolder;
using Clock = std::chrono::steady_clock;

namespace {

std::string record_arguments(const TemporaryFolder& folder, std::uint16_t port,
                             const std::string& more = "") {
  return "record " + (folder.path() / "run").string() +
         " --bind 127.0.0.1 --priority 0 --position-port 0 --port " + std::to_string(port) + " " + more;
}

/// Sends about 2000 numbered packets per second; returns their send times.
std::vector<Clock::time_point> send_numbered(std::uint16_t port, std::uint32_t count) {
  const LoopbackSocket sender;
  std::vector<Clock::time_point> times;
  for (std::uint32_t i = 0; i < count; ++i) {
    sender.send(port, tests::numbered_payload(i));
    times.push_back(Clock::now());
    if (i % 20 == 19) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return times;
}

}  // namespace

TEST_CASE("a killed recording contains every packet up to shortly before the kill", "[record][timed]") {
  const TemporaryFolder folder;
  const std::uint16_t port = tests::free_port();
  NilioProcess recorder(folder.path() / "log", record_arguments(folder, port, "--rotate-mb 1"));
  REQUIRE(recorder.says("recording to"));
  const auto times = send_numbered(port, 10'000);
  const auto killed = Clock::now();
  CHECK(recorder.end(SIGKILL) == -SIGKILL);
  const auto early =
      static_cast<std::size_t>(std::count_if(times.begin(), times.end(), [&](Clock::time_point time) {
        // One second is specified; a busy computer and its disk get two more.
        return killed - time > std::chrono::seconds(3);
      }));
  const auto numbers = numbers_of(tests::read_recording((folder.path() / "run").string(), port));
  CHECK(early > 1000);
  CHECK(numbers.size() >= early);
  CHECK(numbers == tests::count_up(numbers.size()));
}

TEST_CASE("SIGTERM ends a recording with all received packets and a summary", "[record]") {
  const TemporaryFolder folder;
  const std::uint16_t port = tests::free_port();
  NilioProcess recorder(folder.path() / "log", record_arguments(folder, port));
  REQUIRE(recorder.says("recording to"));
  send_numbered(port, 500);
  CHECK(recorder.end(SIGTERM) == 0);
  CHECK_THAT(recorder.output(),
             Contains("recorded   500 packets") && Contains("lost       0 by the kernel, 0 by "
                                                            "full rings, 0 by the disk"));
  CHECK(numbers_of(tests::read_recording((folder.path() / "run").string(), port)) == tests::count_up(500));
}

TEST_CASE("a limit on the size of files ends a part, not the recording", "[record]") {
  const TemporaryFolder folder;
  const std::uint16_t port = tests::free_port();
  // In blocks of 512 bytes.
  NilioProcess recorder(folder.path() / "log", record_arguments(folder, port), "ulimit -f 1000;");
  REQUIRE(recorder.says("recording to"));
  send_numbered(port, 1500);
  CHECK(recorder.end(SIGINT) == 0);
  INFO(recorder.output());
  CHECK(std::filesystem::exists(folder.path() / "run" / "lidar_0004.pcap"));
  CHECK(numbers_of(tests::read_recording((folder.path() / "run").string(), port)) == tests::count_up(1500));
}

TEST_CASE("if no file can be written the recorder reports it, counts the loss and ends cleanly", "[record]") {
  const TemporaryFolder folder;
  const std::uint16_t port = tests::free_port();
  // Too small for a single packet, large enough for the log.
  NilioProcess recorder(folder.path() / "log", record_arguments(folder, port), "ulimit -f 2;");
  REQUIRE(recorder.says("recording to"));
  send_numbered(port, 1000);
  CHECK(recorder.says("cannot be written (File too large)"));
  CHECK(recorder.end(SIGINT) == 1);
  INFO(recorder.output());
  CHECK_THAT(recorder.output(), Contains("ulimit -f"));
  CHECK_THAT(recorder.output(), Contains("lost       0 by the kernel, 0 by full rings"));
}

TEST_CASE("a recording of a silent port fails with advice", "[record]") {
  const TemporaryFolder folder;
  NilioProcess recorder(folder.path() / "log",
                        record_arguments(folder, tests::free_port(), "--duration 0.3"));
  CHECK(recorder.end(0) == 1);
  CHECK_THAT(recorder.output(), Contains("no data were recorded") && Contains("nothing arrives"));
  CHECK(std::filesystem::is_empty(folder.path() / "run"));
}

TEST_CASE("a recording beside the program that owns the port has every packet", "[record]") {
  const TemporaryFolder folder;
  const LoopbackSocket owner;
  NilioProcess recorder(folder.path() / "log", record_arguments(folder, owner.port()));
  if (!recorder.says("recording to")) {
    CHECK_THAT(recorder.output(), Contains("another program has it") && Contains("CAP_NET_RAW"));
    WARN("skipped: no permission for packet sockets");
    return;
  }
  send_numbered(owner.port(), 500);
  CHECK(recorder.end(SIGINT) == 0);
  INFO(recorder.output());
  const auto numbers = numbers_of(tests::read_recording((folder.path() / "run").string(), owner.port()));
  CHECK(numbers == tests::count_up(500));
}

TEST_CASE("errors of recording are one message with the remedy", "[record]") {
  const TemporaryFolder folder;
  const auto expect = [&](const std::string& arguments, const std::string& text) {
    NilioProcess recorder(folder.path() / "log",
                          "record " + (folder.path() / "run").string() + " " + arguments);
    CHECK(recorder.end(0) == 1);
    CHECK_THAT(recorder.output(), Contains("nilio record: ") && Contains(text));
  };
  expect("--port 2370 --position-port 2370", "both 2370");
  expect("--port 0 --position-port 0", "no source to record");
  expect("--port 0 --position-port 0 --can nilio_none0", "CAN nilio_none0");
}
