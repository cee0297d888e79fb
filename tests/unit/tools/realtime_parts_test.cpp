#include "nilio/drivers/network/udp.hpp"

#include "daemon/input/receive.hpp"
#include "tests/support/eventually.hpp"
#include "tests/support/tools_trajectory_support.hpp"
#include "tools/bench/common/process_memory.hpp"
#include "tools/bench/odometry/run_figures.hpp"
#include "tools/bench/realtime/background_load.hpp"
#include "tools/bench/realtime/identity_checks.hpp"
#include "tools/bench/realtime/realtime_table.hpp"
#include "tools/bench/realtime/wakeup_noise.hpp"
#include "tools/common/child_process.hpp"
#include "tools/common/free_port.hpp"
#include "tools/common/monotonic_sleep.hpp"
#include "tools/common/sha256.hpp"

#include <csignal>
#include <tuple>
#include <unistd.h>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using Catch::Matchers::Contains;
using tests::TemporaryFolder;

namespace {

constexpr core::Duration kShort = core::Duration::from_milliseconds(300.0);
constexpr core::Duration kLong = core::Duration::from_seconds(10.0);

const std::string kReport = R"({
  "counters": {"scans": 100, "poses": 98, "scans_superseded": 2, "scans_with_imu": 7},
  "lidars": [{"packets": 7400, "packets_position": 100, "packets_lost": 3, "packets_dropped_kernel": 4, "packets_dropped_ring": 5}],
  "clock_source": "free_running",
  "stages": {"end_to_end": {"count": 98, "p50_us": 3000.0, "p90_us": 4000.0, "p99_us": 5000.0, "p99_9_us": 6000.0,
                            "max_us": 7000.0}},
  "budget": {"mode": "wall", "budget_ms": 20.0, "predicted_by_guard": 1, "late_poses": 2,
             "rungs": {"fewer_points": 5, "full": 85, "prediction": 8, "xyz": 1}, "stops": {"converged": 98},
             "overshoot_us": {"count": 98, "p50": 0.0, "p99": 250.0, "max": 500.0},
             "iteration_us": {"count": 400, "p50": 40.0, "p99": 60.0}}})";

RealtimeCell cell_of(const TemporaryFolder& folder) {
  auto figures = read_run_figures(folder.file("run"));
  REQUIRE(figures.ok());
  RealtimeCell cell;
  cell.run.figures = std::move(figures).value();
  cell.run.noise.p99_us = 12.0;
  cell.run.noise.max_us = 345.0;
  return cell;
}

void write_run(const TemporaryFolder& folder, const std::string& report) {
  std::ignore = folder.write("run/latency.json", report);
  std::ignore = folder.write("run/trajectory.kitti", "1 0 0 0 0 1 0 0 0 0 1 0\n");
  std::ignore = folder.write("run/trajectory.tum", "1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n");
}

}  // namespace

TEST_CASE("a run's figures are those of its files, and a table row has them") {
  const TemporaryFolder folder;
  write_run(folder, kReport);
  const RealtimeCell cell = cell_of(folder);
  const RunFigures& f = cell.run.figures;
  CHECK(f.scans == 100);
  CHECK(f.poses == 98);
  CHECK(f.packets_dropped == 9);
  CHECK(f.overshoot->p99_us == 250.0);
  CHECK(f.trajectory.poses.size() == 2);
  CHECK(f.sha256 == sha256("1 0 0 0 0 1 0 0 0 0 1 0\n"));
  const BenchTable work = realtime_work_table(std::span(&cell, 1));
  REQUIRE(work.rows.size() == 1);
  CHECK(work.headings[9] == "full/fewer_points/prediction/xyz");
  CHECK(work.rows[0] == std::vector<std::string>{"20 (default)", "idle", "100", "98", "-", "7500", "3", "9",
                                                 "2", "85/5/8/1", "2", "7"});
  const BenchTable times = realtime_time_table(std::span(&cell, 1));
  CHECK(times.rows[0][2] == "0.00 / 0.25 / 0.50");
  CHECK(times.rows[0][3] == "40 / 60");
  CHECK(times.rows[0][4] == "3.00 / 5.00");
  CHECK(times.rows[0][9] == "12 / 345 (normal)");
  CHECK(realtime_trajectory_table(std::span(&cell, 1)).rows[0][3] == f.sha256);
  CHECK(latency_chart(std::span(&cell, 1)).curves.size() == 1);
  CHECK(accuracy_chart({}, std::span(&cell, 1)).curves.empty());
}

TEST_CASE("reports that are missing, broken or of another make are errors or empty figures, not crashes") {
  const TemporaryFolder folder;
  CHECK_THAT(read_run_figures(folder.file("run")).error().message, Contains("latency.json"));
  write_run(folder, "[1, 2");
  CHECK_THAT(read_run_figures(folder.file("run")).error().message, Contains("not the JSON"));
  write_run(folder, R"({"counters": 3, "lidars": {}, "budget": {"rungs": [1], "overshoot_us": "x"}})");
  const auto figures = read_run_figures(folder.file("run"));
  REQUIRE(figures.ok());
  CHECK(figures->scans == 0);
  CHECK_FALSE(figures->overshoot);
  CHECK(counts_text(figures->rungs) == "-");
}

TEST_CASE("a live run may lack the file's last pose, and no other") {
  const std::string file = "a\nb\nc\n";
  using Verdict = IdentityCheck::Verdict;
  CHECK(compare_with_file("x", file, "a\nb\nc\n").verdict == Verdict::kPass);
  CHECK(compare_with_file("x", file, "a\nb\n").verdict == Verdict::kPass);
  CHECK(compare_with_file("x", file, "a\nb\n").first == sha256("a\nb\n"));
  CHECK(compare_with_file("x", file, "a\n").verdict == Verdict::kFail);
  CHECK(compare_with_file("x", file, "b\nc\n").verdict == Verdict::kFail);
  CHECK(compare_with_file("x", file, "a\nb\nd\n").verdict == Verdict::kFail);
  CHECK(compare_with_file("x", file, "a\nb\nc\nd\n").verdict == Verdict::kFail);
  CHECK(compare_with_file("x", "", "").verdict == Verdict::kFail);
  CHECK(sha256_of_lines(file, 9) == sha256(file));
  const std::array checks{compare_with_file("x", file, file), compare_with_file("y", file, "a\n")};
  CHECK(any_failed(checks));
  CHECK_FALSE(any_failed(std::span(checks).first(1)));
  CHECK(identity_table(checks).rows[1][1] == "FAIL");
}

TEST_CASE("wake-ups are counted about once a period, those slept through included") {
  WakeupNoise noise;
  const std::int64_t begin = daemon::monotonic_ns();
  sleep_for(kShort);
  CHECK(tests::eventually([&] { return noise.histogram().snapshot().count() > 0; }));
  noise.stop();
  const auto periods = static_cast<std::uint64_t>((daemon::monotonic_ns() - begin) / WakeupNoise::kPeriod.ns);
  const auto snapshot = noise.histogram().snapshot();
  CHECK(snapshot.count() > 0);
  CHECK(snapshot.count() <= 2 * periods);
  CHECK(snapshot.min() >= 0);
  noise.stop();
  CHECK(noise.histogram().snapshot().count() == snapshot.count());
}

TEST_CASE("loads run until their object is gone") {
  pid_t hog = 0;
  {
    const auto hogs = BackgroundLoad::cpu_hogs(2);
    REQUIRE(hogs.ok());
    REQUIRE(hogs->processes().size() == 2);
    CHECK(hogs->is_running());
    hog = hogs->processes().front();
    CHECK(kill(hog, 0) == 0);
    kill(hogs->processes().back(), SIGKILL);
    CHECK(tests::eventually([&] { return !hogs->is_running(); }));
  }
  CHECK(kill(hog, 0) != 0);
}

TEST_CASE("memory pressure touches what it was told to take, and no more") {
  constexpr std::uint64_t bytes = 32 * 1024 * 1024;
  const auto load = BackgroundLoad::memory_pressure(bytes);
  REQUIRE(load.ok());
  std::uint64_t most = 0;
  tests::eventually([&] {
    if (const auto memory = resident_memory(load->processes().front()))
      most = std::max(most, memory->anonymous);
    return most >= bytes * 9 / 10;
  });
  CHECK(load->is_running());
  CHECK(most >= bytes * 9 / 10);
  const auto own = resident_memory(getpid());
  REQUIRE(own);
  CHECK(most <= bytes + own->anonymous);
  CHECK(pressure_bytes(bytes) == bytes);
  CHECK(pressure_bytes(std::uint64_t{1} << 60U) < available_memory() * 2);
}

TEST_CASE("resident memory is counted to the page, and there is none of a process that is gone") {
  const auto before = resident_memory(getpid());
  REQUIRE(before);
  CHECK(before->anonymous <= before->total);
  // More than what comes from a heap that may have pages left.
  const std::vector<char> pages(64 * 1024 * 1024, 'x');
  const auto after = resident_memory(getpid());
  REQUIRE(after);
  CHECK(pages.back() == 'x');
  CHECK(after->anonymous - before->anonymous >= pages.size());
  CHECK_FALSE(resident_memory(0));
}

TEST_CASE("a program's end, its status and its last words are told") {
  const TemporaryFolder folder;
  auto child = ChildProcess::start("/bin/sh", {"-c", "echo one; echo two; exit 3"}, folder.file("log"));
  REQUIRE(child.ok());
  while (!child->poll()) sleep_for(core::Duration::from_milliseconds(1.0));
  CHECK(child->poll() == 3);
  CHECK(child->last_line() == "two");
  CHECK_THAT(ChildProcess::start(folder.file("nothing"), {}, folder.file("log")).error().message,
             Contains("cannot be started"));
}

TEST_CASE("a program that ignores SIGTERM is killed, and one that does not is not") {
  const TemporaryFolder folder;
  auto deaf = ChildProcess::start("/bin/sh", {"-c", "trap '' TERM; echo up; while :; do sleep 0.1; done"},
                                  folder.file("deaf"));
  REQUIRE(deaf.ok());
  while (deaf->last_line() != "up") sleep_for(core::Duration::from_milliseconds(1.0));
  CHECK(deaf->stop(kShort) == -SIGKILL);
  auto good = ChildProcess::start("/bin/sleep", {"1000"}, folder.file("good"));
  REQUIRE(good.ok());
  CHECK(good->stop(kLong) == -SIGTERM);
}

TEST_CASE("a program ends with the object that started it") {
  const TemporaryFolder folder;
  pid_t pid = 0;
  {
    const auto child = ChildProcess::start("/bin/sleep", {"1000"}, folder.file("log"));
    REQUIRE(child.ok());
    pid = child->pid();
    CHECK(kill(pid, 0) == 0);
  }
  CHECK(kill(pid, 0) != 0);
}

TEST_CASE("a UDP port that is taken is named, and others are found") {
  const auto ports = free_udp_ports(0);
  REQUIRE(ports.ok());
  CHECK((*ports)[0] != (*ports)[1]);
  auto taken = drivers::open_udp({.bind_address = "127.0.0.1", .port = (*ports)[0], .position_port = 0});
  REQUIRE(taken.ok());
  const auto refused = free_udp_ports((*ports)[0]);
  REQUIRE_FALSE(refused.ok());
  CHECK_THAT(refused.error().message, Contains(std::to_string((*ports)[0])) && Contains("--port"));
}

TEST_CASE("conditions have names, and other names are none") {
  for (const Condition condition :
       {Condition::kIdle, Condition::kHogs, Condition::kMemory, Condition::kSlowSubscriber})
    CHECK(parse_condition(condition_name(condition)) == condition);
  CHECK_FALSE(parse_condition("busy"));
}
