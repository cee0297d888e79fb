#include "tests/support/tools/record_support.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using Catch::Matchers::Contains;
using tests::NilioProcess;
using tests::TemporaryFolder;

namespace {

namespace fs = std::filesystem;

}  // namespace

TEST_CASE("wrong usage of any command ends with status 2", "[program]") {
  const TemporaryFolder folder;
  for (const char* line : {"", "bogus", "--bogus", "evaluate", "evaluate a b --align c", "simulate",
                           "simulate x --rpm 1", "inspect", "plot a", "bench", "bench decode --rounds 0",
                           "bench realtime", "record", "watch --domain x"}) {
    CAPTURE(line);
    NilioProcess nilio(folder.path() / "log", line);
    CHECK(nilio.end(0) == 2);
    CHECK_FALSE(nilio.output().empty());
  }
  NilioProcess help(folder.path() / "log", "--help");
  CHECK(help.end(0) == 0);
  CHECK_THAT(help.output(), Contains("Exit status:\n  0  done"));
}

TEST_CASE("an interrupted simulation leaves nothing that replays as a whole drive", "[program]") {
  const TemporaryFolder folder;
  const fs::path drive = folder.path() / "drive";
  const std::string command = "simulate " + drive.string() + " --moving-cars 0 --duration ";
  {
    NilioProcess whole(folder.path() / "log", command + "1");
    REQUIRE(whole.end(0) == 0);
  }
  CHECK(fs::exists(drive / "lidar.pcap"));
  CHECK_FALSE(fs::exists(drive / "lidar.pcap.partial"));
  NilioProcess half(folder.path() / "log", command + "600");
  REQUIRE(tests::eventually([&] {
    std::error_code none;
    return fs::exists(drive / "lidar.pcap.partial") &&
           fs::file_size(drive / "lidar.pcap.partial", none) > 100'000;
  }));
  CHECK(half.end(SIGINT) == -SIGINT);
  CHECK_FALSE(fs::exists(drive / "lidar.pcap"));
  const auto files = daemon::find_replay_files({drive.string()});
  REQUIRE_FALSE(files.ok());
  CHECK_THAT(files.error().message, Contains("lidar.pcap.partial: is unfinished"));
}
