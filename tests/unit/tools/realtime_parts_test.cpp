#include "nilio/core/clock.hpp"
#include "nilio/drivers/network/udp.hpp"

#include "daemon/output/sha256.hpp"
#include "tests/support/eventually.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tools/bench/common/memory_use.hpp"
#include "tools/bench/common/niliod_run.hpp"
#include "tools/bench/realtime/identity_checks.hpp"
#include "tools/bench/realtime/stress_load.hpp"
#include "tools/bench/realtime/tables.hpp"
#include "tools/bench/realtime/wakeup_latency.hpp"
#include "tools/common/child_process.hpp"
#include "tools/common/system.hpp"

#include <csignal>
#include <tuple>
#include <unistd.h>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::bench;
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
             "degradation_levels": {"fewer_points": 5, "full": 85, "prediction": 8, "xyz": 1}, "stops": {"converged": 98},
             "overshoot_us": {"count": 98, "p50": 0.0, "p99": 250.0, "max": 500.0},
             "iteration_us": {"count": 400, "p50": 40.0, "p99": 60.0}}})";

RealtimeCell cell_of(const TemporaryFolder& folder) {
  auto figures = read_run_figures(folder.file("run"));
  REQUIRE(figures.ok());
  RealtimeCell cell;
  cell.run.figures = std::move(figures).value();
  cell.run.wakeup.p99_us = 12.0;
  cell.run.wakeup.max_us = 345.0;
  return cell;
}

void write_run(const TemporaryFolder& folder, const std::string& report) {
  std::ignore = folder.write("run/latency.json", report);
  std::ignore = folder.write("run/trajectory.kitti", "1 0 0 0 0 1 0 0 0 0 1 0\n");
  std::ignore = folder.write("run/trajectory.tum", "1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n");
}

}  // namespace

TEST_CASE("the figures of a run are read from its files and shown in table rows", "[realtime_parts]") {
  const TemporaryFolder folder;
  write_run(folder, kReport);
  const RealtimeCell cell = cell_of(folder);
  const NiliodFigures& f = cell.run.figures;
  CHECK(f.scans == 100);
  CHECK(f.poses == 98);
  CHECK(f.packets_dropped == 9);
  CHECK(f.overshoot->p99_us == 250.0);
  CHECK(f.trajectory.poses.size() == 2);
  CHECK(f.sha256 == daemon::sha256("1 0 0 0 0 1 0 0 0 0 1 0\n"));
  const Table work = realtime_work_table(std::span(&cell, 1));
  REQUIRE(work.rows.size() == 1);
  CHECK(work.headings[9] == "full/fewer_points/prediction/xyz");
  CHECK(work.rows[0] == std::vector<std::string>{"20 (default)", "idle", "100", "98", "-", "7500", "3", "9",
                                                 "2", "85/5/8/1", "2", "7"});
  const Table times = realtime_time_table(std::span(&cell, 1));
  CHECK(times.rows[0][2] == "0.00 / 0.25 / 0.50");
  CHECK(times.rows[0][3] == "40 / 60");
  CHECK(times.rows[0][4] == "3.00 / 5.00");
  CHECK(times.rows[0][11] == "12 / 345 (normal)");
  CHECK(realtime_trajectory_table(std::span(&cell, 1)).rows[0][3] == f.sha256);
  CHECK(realtime_latency_figure(std::span(&cell, 1)).panels[0].curves.size() == 1);
  CHECK(accuracy_figure({}, std::span(&cell, 1)).panels[0].curves.empty());
}

TEST_CASE("missing, damaged or foreign reports give errors or empty figures", "[realtime_parts]") {
  const TemporaryFolder folder;
  CHECK_THAT(read_run_figures(folder.file("run")).error().message, Contains("latency.json"));
  write_run(folder, "[1, 2");
  CHECK_THAT(read_run_figures(folder.file("run")).error().message, Contains("not the JSON"));
  write_run(folder,
            R"({"counters": 3, "lidars": {}, "budget": {"degradation_levels": [1], "overshoot_us": "x"}})");
  const auto figures = read_run_figures(folder.file("run"));
  REQUIRE(figures.ok());
  CHECK(figures->scans == 0);
  CHECK_FALSE(figures->overshoot);
  CHECK(counts_text(figures->degradation_levels) == "-");
}

TEST_CASE("a live run may lack the last pose of the file, and no other", "[realtime_parts]") {
  const std::string file = "a\nb\nc\n";
  using Verdict = IdentityCheck::Verdict;
  CHECK(compare_with_file("x", file, "a\nb\nc\n").verdict == Verdict::kPass);
  CHECK(compare_with_file("x", file, "a\nb\n").verdict == Verdict::kPass);
  CHECK(compare_with_file("x", file, "a\nb\n").first == daemon::sha256("a\nb\n"));
  CHECK(compare_with_file("x", file, "a\n").verdict == Verdict::kFail);
  CHECK(compare_with_file("x", file, "b\nc\n").verdict == Verdict::kFail);
  CHECK(compare_with_file("x", file, "a\nb\nd\n").verdict == Verdict::kFail);
  CHECK(compare_with_file("x", file, "a\nb\nc\nd\n").verdict == Verdict::kFail);
  CHECK(compare_with_file("x", "", "").verdict == Verdict::kFail);
  CHECK(sha256_of_lines(file, 9) == daemon::sha256(file));
  const std::array checks{compare_with_file("x", file, file), compare_with_file("y", file, "a\n")};
  CHECK(any_failed(checks));
  CHECK_FALSE(any_failed(std::span(checks).first(1)));
  CHECK(identity_table(checks).rows[1][1] == "FAIL");
}

TEST_CASE("wake-ups are counted about once a period, missed periods included", "[realtime_parts]") {
  WakeupLatency wakeup;
  const std::int64_t begin = monotonic_ns();
  sleep_for(kShort);
  CHECK(tests::eventually([&] { return wakeup.histogram().snapshot().count() > 0; }));
  wakeup.stop();
  const auto periods = static_cast<std::uint64_t>((monotonic_ns() - begin) / WakeupLatency::kPeriod.ns);
  const auto snapshot = wakeup.histogram().snapshot();
  CHECK(snapshot.count() > 0);
  CHECK(snapshot.count() <= 2 * periods);
  CHECK(snapshot.min() >= 0);
  wakeup.stop();
  CHECK(wakeup.histogram().snapshot().count() == snapshot.count());
}

TEST_CASE("load processes run until their object is destroyed", "[realtime_parts]") {
  pid_t process = 0;
  {
    const auto load = StressLoad::cpu_load(2);
    REQUIRE(load.ok());
    REQUIRE(load->processes().size() == 2);
    CHECK(load->is_running());
    process = load->processes().front();
    CHECK(kill(process, 0) == 0);
    kill(load->processes().back(), SIGKILL);
    CHECK(tests::eventually([&] { return !load->is_running(); }));
  }
  CHECK(kill(process, 0) != 0);
}

TEST_CASE("memory pressure touches the requested memory, and no more", "[realtime_parts]") {
  constexpr std::uint64_t bytes = 32 * 1024 * 1024;
  const auto load = StressLoad::memory_pressure(bytes);
  REQUIRE(load.ok());
  std::uint64_t maximum = 0;
  tests::eventually([&] {
    if (const auto memory = resident_memory(load->processes().front()))
      maximum = std::max(maximum, memory->anonymous);
    return maximum >= bytes * 9 / 10;
  });
  CHECK(load->is_running());
  CHECK(maximum >= bytes * 9 / 10);
  const auto own = resident_memory(getpid());
  REQUIRE(own);
  CHECK(maximum <= bytes + own->anonymous);
  CHECK(pressure_bytes(bytes) == bytes);
  CHECK(pressure_bytes(std::uint64_t{1} << 60U) < available_memory() * 2);
}

TEST_CASE("resident memory is exact to the page, and empty for a process that has ended",
          "[realtime_parts]") {
  const auto before = resident_memory(getpid());
  REQUIRE(before);
  CHECK(before->anonymous <= before->total);
  // More than the free pages of the heap.
  const std::vector<char> pages(64 * 1024 * 1024, 'x');
  const auto after = resident_memory(getpid());
  REQUIRE(after);
  CHECK(pages.back() == 'x');
  CHECK(after->anonymous - before->anonymous >= pages.size());
  CHECK_FALSE(resident_memory(0));
}

TEST_CASE("the status and the last line of a child process are reported", "[realtime_parts]") {
  const TemporaryFolder folder;
  auto child = ChildProcess::start("/bin/sh", {"-c", "echo one; echo two; exit 3"}, folder.file("log"));
  REQUIRE(child.ok());
  while (!child->poll()) sleep_for(core::Duration::from_milliseconds(1.0));
  CHECK(child->poll() == 3);
  CHECK(child->last_line() == "two");
  CHECK_THAT(ChildProcess::start(folder.file("nothing"), {}, folder.file("log")).error().message,
             Contains("could not be started"));
}

TEST_CASE("a child process is killed only when it ignores SIGTERM", "[realtime_parts]") {
  const TemporaryFolder folder;
  auto stubborn = ChildProcess::start("/bin/sh", {"-c", "trap '' TERM; echo up; while :; do sleep 0.1; done"},
                                      folder.file("stubborn"));
  REQUIRE(stubborn.ok());
  while (stubborn->last_line() != "up") sleep_for(core::Duration::from_milliseconds(1.0));
  CHECK(stubborn->stop(kShort) == -SIGKILL);
  auto good = ChildProcess::start("/bin/sleep", {"1000"}, folder.file("good"));
  REQUIRE(good.ok());
  CHECK(good->stop(kLong) == -SIGTERM);
}

TEST_CASE("a child process ends with its object", "[realtime_parts]") {
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

TEST_CASE("a UDP port in use is reported, and free ones are found", "[realtime_parts]") {
  const auto ports = free_udp_ports(0);
  REQUIRE(ports.ok());
  CHECK((*ports)[0] != (*ports)[1]);
  auto taken = drivers::open_udp({.bind_address = "127.0.0.1", .port = (*ports)[0], .position_port = 0});
  REQUIRE(taken.ok());
  const auto refused = free_udp_ports((*ports)[0]);
  REQUIRE_FALSE(refused.ok());
  CHECK_THAT(refused.error().message, Contains(std::to_string((*ports)[0])) && Contains("--port"));
}

TEST_CASE("conditions have names, and other names are refused", "[realtime_parts]") {
  for (std::size_t i = 0; i < kConditions; ++i) {
    const auto condition = static_cast<Condition>(i);
    CHECK(parse_condition(condition_name(condition)) == condition);
  }
  CHECK(parse_condition("full-disk") == Condition::kFullDisk);
  CHECK_FALSE(parse_condition("busy"));
}

TEST_CASE("the lines of the independent reader give poses and latency of this machine", "[realtime_parts]") {
  const ReaderFigures figures = read_reader_lines(
      "ready 1\npose 100 5000000\npacket 100 1000000 here\npacket 200 2000000 here\npose 200 4000000\n"
      "pose 300 9000000\npacket 300 1 elsewhere\npose 4",
      "here");
  CHECK(figures.poses == 3);
  CHECK(figures.is_fifo);
  CHECK(figures.packet_to_reader.count == 2);
  CHECK(figures.packet_to_reader.max_us == Approx(4000.0).epsilon(0.01));
  CHECK(read_reader_lines("", "here").poses == 0);
}

TEST_CASE("the disk library makes one folder slow or full, and no other", "[realtime_parts]") {
  const auto library = find_sibling_program("libnilio-slow-disk.so");
  REQUIRE(library.ok());
  if (!std::filesystem::exists("/usr/bin/python3")) {
    WARN("skipped: no python3");
    return;
  }
  const TemporaryFolder folder;
  REQUIRE_FALSE(folder.write("slow/x", "").empty());
  // Status of a program that writes to a file there, and how long it took.
  const auto write_to = [&](const std::string& file, const std::string& variable) {
    const std::int64_t begin = monotonic_ns();
    // Three writes of a system call each. Programs of the C library's streams call no exported function.
    const std::string script =
        "import os, sys\nfile = os.open(sys.argv[1], os.O_CREAT | os.O_WRONLY)\n"
        "for _ in range(3): os.write(file, b'x' * 100)\n";
    auto child = ChildProcess::start(
        "/usr/bin/python3", {"-c", script, folder.file(file)}, folder.file("log"),
        {"LD_PRELOAD=" + library->string(), variable, "NILIO_DISK_FOLDER=" + folder.file("slow")});
    REQUIRE(child.ok());
    while (!child->poll()) sleep_for(core::Duration::from_milliseconds(1.0));
    return std::pair(*child->poll(), 1e-9 * static_cast<double>(monotonic_ns() - begin));
  };
  const auto [slow_status, slow_s] = write_to("slow/a", "NILIO_DISK_WRITE_MS=200");
  CHECK(slow_status == 0);
  CHECK(slow_s >= 0.6);
  CHECK(std::filesystem::file_size(folder.file("slow/a")) == 300);
  const std::string full = "NILIO_DISK_FULL_FILE=" + folder.write("full", "");
  CHECK(write_to("slow/b", full).first == 1);
  CHECK(write_to("other", full).first == 0);
  std::filesystem::remove(folder.file("full"));
  CHECK(write_to("slow/b", full).first == 0);
}
