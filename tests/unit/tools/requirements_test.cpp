#include "tools/bench/realtime/requirements.hpp"

#include "tests/support/temporary_folder.hpp"
#include "tools/bench/realtime/thread_watch.hpp"
#include "tools/common/child_process.hpp"
#include "tools/common/files.hpp"
#include "tools/common/system.hpp"

#include <algorithm>
#include <array>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::bench;
using tests::TemporaryFolder;
using Verdict = Requirement::Verdict;

namespace {

ipc::LatencySummary latency(double p50_us, double p99_us) {
  ipc::LatencySummary summary;
  summary.count = 100;
  summary.p50_us = p50_us;
  summary.p99_us = p99_us;
  return summary;
}

/// A run that meets all requirements.
RealtimeCell good_cell() {
  RealtimeCell cell;
  NiliodFigures& f = cell.run.figures;
  f.scans = f.poses = 100;
  f.scans_with_imu = 90;
  f.overshoot = latency(0.0, 30.0);
  f.iteration = latency(50.0, 70.0);
  cell.run.wakeup = latency(2.0, 20.0);
  cell.run.packet_to_subscriber = latency(4000.0, 9000.0);
  cell.run.imu_pose = latency(100.0, 900.0);
  cell.run.watch = ThreadWatch{{{"nilio-odometry", 1, {{"allocation", 0}, {"lock", 0}}}}, {}, 0, 5.0, {}};
  return cell;
}

/// Verdict of the only requirement whose name begins with that text.
Verdict verdict_of(const std::vector<Requirement>& requirements, const std::string& beginning) {
  std::vector<Verdict> found;
  for (const Requirement& requirement : requirements) {
    if (requirement.name.starts_with(beginning)) found.push_back(requirement.verdict);
  }
  REQUIRE(found.size() == 1);
  return found.front();
}

std::vector<Requirement> check(const RealtimeCell& cell) {
  return check_requirements({{&cell, 1}, {}, {}, nullptr});
}

}  // namespace

TEST_CASE("a good run meets its requirements, and missing measurements are reported as such",
          "[requirements]") {
  const std::vector<Requirement> requirements = check(good_cell());
  CHECK(verdict_of(requirements, "beyond the budget") == Verdict::kMet);
  CHECK(verdict_of(requirements, "one pose per scan") == Verdict::kMet);
  CHECK(verdict_of(requirements, "no packet lost") == Verdict::kMet);
  CHECK(verdict_of(requirements, "allocations") == Verdict::kMet);
  CHECK(verdict_of(requirements, "last packet to subscriber") == Verdict::kMet);
  CHECK(verdict_of(requirements, "control run") == Verdict::kNotMeasured);
  CHECK_FALSE(any_failed(requirements));
  CHECK(requirement_table(requirements).rows.size() == requirements.size());
}

TEST_CASE("requirements missed by the clock differ from failures that do not depend on the computer",
          "[requirements]") {
  RealtimeCell cell = good_cell();
  cell.run.figures.overshoot = latency(0.0, 71.0);
  cell.run.packet_to_subscriber = latency(10'001.0, 0.0);
  cell.run.figures.packets_lost = 1;
  std::vector<Requirement> requirements = check(cell);
  CHECK(verdict_of(requirements, "beyond the budget") == Verdict::kMissed);
  CHECK(verdict_of(requirements, "last packet to subscriber") == Verdict::kMissed);
  CHECK(verdict_of(requirements, "no packet lost") == Verdict::kMissed);
  CHECK_FALSE(any_failed(requirements));
  cell.run.figures.poses = 99;
  CHECK(verdict_of(check(cell), "one pose per scan") == Verdict::kFailed);
  cell.run.figures.superseded = 1;
  CHECK(verdict_of(check(cell), "one pose per scan") == Verdict::kMissed);
  cell.run.watch->threads[0].counts[1].second = 2;
  requirements = check(cell);
  CHECK(verdict_of(requirements, "allocations") == Verdict::kFailed);
  CHECK(any_failed(requirements));
}

TEST_CASE("a disk that does not take the report leaves a run unmeasured, but for the reader",
          "[requirements]") {
  RealtimeCell idle = good_cell();
  idle.run.figures.budget_ms = 50.0;
  idle.run.reader = ReaderFigures{100, latency(3000.0, 5000.0)};
  RealtimeCell slow;
  slow.condition = Condition::kSlowDisk;
  slow.run.watch = idle.run.watch;
  slow.run.reader = idle.run.reader;
  const auto verdicts = [&](const std::string& beginning) {
    const std::array<RealtimeCell, 2> cells{idle, slow};
    std::vector<Verdict> found;
    for (const Requirement& requirement : check_requirements({cells, {}, {}, nullptr})) {
      if (requirement.name.starts_with(beginning)) found.push_back(requirement.verdict);
    }
    return found;
  };
  using Verdicts = std::vector<Verdict>;
  CHECK(verdicts("one pose per scan") == Verdicts{Verdict::kMet, Verdict::kNotMeasured});
  CHECK(verdicts("no packet lost") == Verdicts{Verdict::kMet, Verdict::kNotMeasured});
  CHECK(verdicts("every pose at an independent reader") == Verdicts{Verdict::kMet});
  CHECK(verdicts("last packet to an independent reader") == Verdicts{Verdict::kMet, Verdict::kMet});
  CHECK(verdicts("every pose in trajectory.tum") == Verdicts{Verdict::kMissed});
  slow.run.reader->poses = 99;
  CHECK(verdicts("every pose at an independent reader") == Verdicts{Verdict::kMet, Verdict::kMissed});
}

TEST_CASE("accuracy by the clock has a verdict: at most twice the error of the whole computation",
          "[requirements]") {
  RealtimeCell cell = good_cell();
  const auto verdict = [&](std::optional<double> whole) {
    return verdict_of(check_requirements({{&cell, 1}, {}, {}, nullptr, {whole, std::nullopt}}), "accuracy");
  };
  CHECK(verdict(0.5) == Verdict::kNotMeasured);
  cell.translation_percent = 0.9;
  CHECK(verdict(0.5) == Verdict::kMet);
  CHECK(verdict(std::nullopt) == Verdict::kNotMeasured);
  cell.translation_percent = 1.1;
  CHECK(verdict(0.5) == Verdict::kMissed);
  // Differences below 0.1 % are none.
  cell.translation_percent = 0.09;
  CHECK(verdict(0.01) == Verdict::kMet);
  // Runs of the files have a reference of their own.
  cell.feed = Feed::kReplay;
  CHECK(verdict(0.01) == Verdict::kNotMeasured);
}

TEST_CASE("an independent reader has every pose within the budget and 5 ms", "[requirements]") {
  RealtimeCell cell = good_cell();
  cell.run.why_no_reader = "not built";
  CHECK(verdict_of(check(cell), "every pose at an independent reader") == Verdict::kNotMeasured);
  cell.run.figures.budget_ms = 50.0;
  cell.run.reader = ReaderFigures{100, latency(4000.0, 54'000.0), true};
  CHECK(verdict_of(check(cell), "last packet to an independent reader") == Verdict::kMet);
  CHECK(verdict_of(check(cell), "every pose at an independent reader") == Verdict::kMet);
  cell.run.reader = ReaderFigures{99, latency(4000.0, 56'000.0), true};
  CHECK(verdict_of(check(cell), "last packet to an independent reader") == Verdict::kMissed);
  CHECK(verdict_of(check(cell), "every pose at an independent reader") == Verdict::kMissed);
}

TEST_CASE("a bad disk may cost neither poses in the files nor the time to stop", "[requirements]") {
  RealtimeCell cell = good_cell();
  cell.condition = Condition::kSlowDisk;
  cell.run.figures.trajectory.poses.resize(100);
  cell.run.stop_s = 1.9;
  CHECK(verdict_of(check(cell), "every pose in trajectory.tum") == Verdict::kMet);
  CHECK(verdict_of(check(cell), "SIGTERM") == Verdict::kMet);
  cell.run.figures.trajectory.poses.resize(99);
  cell.run.stop_s = 2.1;
  CHECK(verdict_of(check(cell), "every pose in trajectory.tum") == Verdict::kMissed);
  CHECK(verdict_of(check(cell), "SIGTERM") == Verdict::kMissed);
}

TEST_CASE("poses at IMU rate are checked under CPU load, where there is an IMU", "[requirements]") {
  RealtimeCell cell = good_cell();
  cell.condition = Condition::kCpuLoad;
  CHECK(verdict_of(check(cell), "pose at IMU rate") == Verdict::kMet);
  cell.run.imu_pose = latency(100.0, 1021.0);
  CHECK(verdict_of(check(cell), "pose at IMU rate") == Verdict::kMissed);
  cell.run.imu_pose.reset();
  CHECK(verdict_of(check(cell), "pose at IMU rate") == Verdict::kNotMeasured);
}

TEST_CASE("runs that all meet a requirement share a line, otherwise each has its own", "[requirements]") {
  std::array cells{good_cell(), good_cell(), good_cell()};
  const auto lines = [&cells] {
    const std::vector<Requirement> requirements = check_requirements({cells, {}, {}, nullptr});
    return std::count_if(requirements.begin(), requirements.end(), [](const Requirement& requirement) {
      return requirement.name == "one pose per scan";
    });
  };
  CHECK(lines() == 1);
  cells[1].run.figures.poses = 7;
  CHECK(lines() == 3);
}

TEST_CASE("the control run has to count all three forbidden calls", "[requirements]") {
  ThreadWatch watch{
      {{"nilio-odometry", 1, {{"allocation", 1}, {"release", 1}, {"lock", 1}}}}, {}, 0, 5.0, {}};
  CHECK(forbidden_calls(watch) == 3);
  const auto planted = [&watch] {
    return verdict_of(check_requirements({{}, {}, {}, &watch}), "control run");
  };
  CHECK(planted() == Verdict::kMet);
  watch.threads[0].counts[2].second = 0;
  CHECK(planted() == Verdict::kFailed);
}

TEST_CASE("a counted budget is kept within one iteration, or the requirement fails", "[requirements]") {
  CountedRun run;
  run.figures.overshoot = latency(0.0, 10.0);
  run.figures.iteration = latency(59.0, 59.0);
  const auto verdict = [&run] {
    return verdict_of(check_requirements({{}, {&run, 1}, {}, nullptr}), "beyond the budget");
  };
  CHECK(verdict() == Verdict::kMet);
  run.figures.overshoot = latency(0.0, 59.0);
  CHECK(verdict() == Verdict::kFailed);
}

TEST_CASE("a child process inherits the environment, with the given variables replaced", "[requirements]") {
  const TemporaryFolder folder;
  REQUIRE(setenv("NILIO_TEST_KEPT", "kept", 1) == 0);
  REQUIRE(setenv("NILIO_TEST_REPLACED", "old", 1) == 0);
  auto child = ChildProcess::start("/bin/sh", {"-c", "echo $NILIO_TEST_KEPT $NILIO_TEST_REPLACED; env"},
                                   folder.file("log"), {"NILIO_TEST_REPLACED=new"});
  REQUIRE(child.ok());
  while (!child->poll()) sleep_for(core::Duration::from_milliseconds(1.0));
  const std::string text = file_text(folder.file("log")).value_or("");
  CHECK(text.starts_with("kept new\n"));
  CHECK(text.find("NILIO_TEST_REPLACED=old") == std::string::npos);
  unsetenv("NILIO_TEST_KEPT");
  unsetenv("NILIO_TEST_REPLACED");
}

TEST_CASE("a run without a report of forbidden calls is not measured and has a reason", "[requirements]") {
  const TemporaryFolder folder;
  const auto watch = read_thread_watch(folder.file(""));
  REQUIRE_FALSE(watch.ok());
  // Depends on whether the library was built.
  const bool is_known = watch.error().message.find("is not beside this program") != std::string::npos ||
                        watch.error().message.find("before the end of its warm-up") != std::string::npos;
  CHECK(is_known);
}
