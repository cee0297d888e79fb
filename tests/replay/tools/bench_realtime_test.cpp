#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include "tests/support/read_all.hpp"
#include "tests/support/tools/town_drive.hpp"
#include "tools/bench/common/sensor_drive.hpp"

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::bench;
using tests::read_all;
using tests::read_file;
using tests::run_bench;
using tests::TemporaryFolder;
using tests::town_drive;

namespace {

/// Number of occurrences of a text in another.
std::size_t count_of(const std::string& text, const std::string& part) {
  std::size_t count = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

}  // namespace

TEST_CASE("the beginning of a drive has its first packets and frames, bit by bit, and no later ones",
          "[bench_realtime][drives]") {
  const TemporaryFolder folder;
  const auto drive = open_sensor_drive(town_drive());
  REQUIRE(drive.ok());
  REQUIRE(drive->truth);
  const std::filesystem::path out = std::filesystem::path(folder.file("x")).parent_path();
  const auto part = write_beginning(*drive, core::Duration::from_seconds(1.0), out);
  REQUIRE(part.ok());
  auto whole = drivers::open_pcap(town_drive() + "/lidar.pcap", {});
  auto begun = drivers::open_pcap(part->files.captures.front(), {});
  REQUIRE(whole.ok());
  REQUIRE(begun.ok());
  const auto all = read_all(**whole);
  const auto first = read_all(**begun);
  REQUIRE(first.size() == part->packets);
  REQUIRE(first.size() < all.size());
  for (std::size_t i = 0; i < first.size(); ++i) {
    REQUIRE(first[i].stamp == all[i].stamp);
    REQUIRE(first[i].data == all[i].data);
    REQUIRE(first[i].sender_address == all[i].sender_address);
  }
  const core::Time end = all.front().stamp + core::Duration::from_seconds(1.0);
  CHECK(first.back().stamp < end);
  CHECK(all[first.size()].stamp >= end);
  auto log = drivers::open_candump(part->files.can_logs.front(), "");
  REQUIRE(log.ok());
  const auto frames = read_all(**log);
  REQUIRE(frames.size() > 100);
  CHECK(frames.back().stamp < end);
  CHECK(part->files.configuration == drive->files.configuration);
}

TEST_CASE("drives without packets and unknown names are refused before a program is started",
          "[bench_realtime]") {
  const TemporaryFolder folder;
  CHECK(run_bench({"realtime"}) == -1);
  CHECK(run_bench({"realtime", folder.file("nowhere")}) == -1);
  CHECK(run_bench({"realtime", folder.file("nowhere"), "--conditions", "busy"}) == -1);
  CHECK(run_bench({"realtime", folder.file("nowhere"), "--budgets", "0"}) == -1);
  CHECK(run_bench({"realtime", folder.file("nowhere"), "--feed", "tcp"}) == -1);
  CHECK(run_bench({"realtime", folder.file("nowhere"), "--seconds", "nan"}) == -1);
  CHECK(run_bench({"realtime", folder.file("nowhere"), "--soak", "0"}) == -1);
}

TEST_CASE("one command runs niliod under a budget and loads, checks the identity of poses and writes a page",
          "[bench_realtime][drives][timed]") {
  const TemporaryFolder folder;
  REQUIRE(run_bench({"realtime", town_drive(), "--seconds", "2", "--budgets", "20", "--conditions",
                     "cpu,memory,subscriber", "--memory-mib", "64", "--page", folder.file("page.md"),
                     "--domain", "232"}) == 0);
  const std::string page = read_file(folder.file("page.md"));
  CHECK(page.find("Made by\n\n```sh\n") != std::string::npos);
  for (const char* part : {"| 20 | idle |", "| cpu |", "| memory |", "| subscriber |", "(default)"})
    CHECK(page.find(part) != std::string::npos);
  // Only runs from files have an IMU here.
  CHECK(page.find("| idle, --as-live |") != std::string::npos);
  CHECK(page.find("### Requirements") != std::string::npos);
  CHECK(count_of(page, "| FAILED |") == 0);
  CHECK(count_of(page, "| FAIL |") == 0);
  CHECK(count_of(page, "| PASS |") + count_of(page, "| not comparable |") == 6);
  // The checks of threads and load need no network.
  CHECK(count_of(page, "| PASS |") >= 3);
  CHECK(read_file(folder.file("realtime-latency-town.svg")).find("<svg") != std::string::npos);
}
