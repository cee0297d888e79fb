#include "tools/bench/realtime/realtime_summary.hpp"

#include "tests/support/tools_trajectory_support.hpp"
#include "tools/bench/realtime/thread_watch.hpp"
#include "tools/common/child_process.hpp"
#include "tools/common/file_text.hpp"
#include "tools/common/monotonic_sleep.hpp"

#include <algorithm>
#include <array>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using tests::TemporaryFolder;
using Verdict = Demand::Verdict;

namespace {

ipc::LatencySummary latency(double p50_us, double p99_us) {
  ipc::LatencySummary summary;
  summary.count = 100;
  summary.p50_us = p50_us;
  summary.p99_us = p99_us;
  return summary;
}

/// A run that has all that is asked.
RealtimeCell good_cell() {
  RealtimeCell cell;
  RunFigures& f = cell.run.figures;
  f.scans = f.poses = 100;
  f.scans_with_imu = 90;
  f.overshoot = latency(0.0, 30.0);
  f.iteration = latency(50.0, 70.0);
  cell.run.noise = latency(2.0, 20.0);
  cell.run.packet_to_subscriber = latency(4000.0, 9000.0);
  cell.run.imu_pose = latency(100.0, 900.0);
  cell.run.watch = ThreadWatch{{{"nilio-odometry", 1, {{"allocation", 0}, {"lock", 0}}}}, {}, 0, 5.0, {}};
  return cell;
}

/// Verdict of the demands whose text begins like that; there has to be just one.
Verdict verdict_of(const std::vector<Demand>& demands, const std::string& beginning) {
  std::vector<Verdict> found;
  for (const Demand& demand : demands) {
    if (demand.asked.starts_with(beginning)) found.push_back(demand.verdict);
  }
  REQUIRE(found.size() == 1);
  return found.front();
}

std::vector<Demand> judge(const RealtimeCell& cell) { return judge_realtime({{&cell, 1}, {}, {}, nullptr}); }

}  // namespace

TEST_CASE("a run that has what is asked meets it, and what nobody measured is said to be so") {
  const std::vector<Demand> demands = judge(good_cell());
  CHECK(verdict_of(demands, "past the budget") == Verdict::kMet);
  CHECK(verdict_of(demands, "one pose a scan") == Verdict::kMet);
  CHECK(verdict_of(demands, "no packet lost") == Verdict::kMet);
  CHECK(verdict_of(demands, "allocations") == Verdict::kMet);
  CHECK(verdict_of(demands, "last packet to subscriber") == Verdict::kMet);
  CHECK(verdict_of(demands, "allocation, release and lock planted") == Verdict::kNotMeasured);
  CHECK_FALSE(any_failed(demands));
  CHECK(demand_table(demands).rows.size() == demands.size());
}

TEST_CASE("what is missed by the clock is told from what fails on every computer") {
  RealtimeCell cell = good_cell();
  cell.run.figures.overshoot = latency(0.0, 71.0);
  cell.run.packet_to_subscriber = latency(10'001.0, 0.0);
  cell.run.figures.packets_lost = 1;
  std::vector<Demand> demands = judge(cell);
  CHECK(verdict_of(demands, "past the budget") == Verdict::kMissed);
  CHECK(verdict_of(demands, "last packet to subscriber") == Verdict::kMissed);
  CHECK(verdict_of(demands, "no packet lost") == Verdict::kMissed);
  CHECK_FALSE(any_failed(demands));
  cell.run.figures.poses = 99;
  CHECK(verdict_of(judge(cell), "one pose a scan") == Verdict::kFailed);
  cell.run.figures.superseded = 1;
  CHECK(verdict_of(judge(cell), "one pose a scan") == Verdict::kMissed);
  cell.run.watch->threads[0].counts[1].second = 2;
  demands = judge(cell);
  CHECK(verdict_of(demands, "allocations") == Verdict::kFailed);
  CHECK(any_failed(demands));
}

TEST_CASE("poses at IMU rate are judged under hogs, where there is an IMU") {
  RealtimeCell cell = good_cell();
  cell.condition = Condition::kHogs;
  CHECK(verdict_of(judge(cell), "pose at IMU rate") == Verdict::kMet);
  cell.run.imu_pose = latency(100.0, 1021.0);
  CHECK(verdict_of(judge(cell), "pose at IMU rate") == Verdict::kMissed);
  cell.run.imu_pose.reset();
  CHECK(verdict_of(judge(cell), "pose at IMU rate") == Verdict::kNotMeasured);
}

TEST_CASE("runs that all meet a demand share a line, and one that does not has its own") {
  std::array cells{good_cell(), good_cell(), good_cell()};
  const auto lines = [&cells] {
    const std::vector<Demand> demands = judge_realtime({cells, {}, {}, nullptr});
    return std::count_if(demands.begin(), demands.end(),
                         [](const Demand& demand) { return demand.asked == "one pose a scan"; });
  };
  CHECK(lines() == 1);
  cells[1].run.figures.poses = 7;
  CHECK(lines() == 3);
}

TEST_CASE("a planted offence has to be counted, each of the three") {
  ThreadWatch watch{
      {{"nilio-odometry", 1, {{"allocation", 1}, {"release", 1}, {"lock", 1}}}}, {}, 0, 5.0, {}};
  CHECK(offences(watch) == 3);
  const auto planted = [&watch] {
    return verdict_of(judge_realtime({{}, {}, {}, &watch}), "allocation, release and lock planted");
  };
  CHECK(planted() == Verdict::kMet);
  watch.threads[0].counts[2].second = 0;
  CHECK(planted() == Verdict::kFailed);
}

TEST_CASE("a budget that is counted is kept to an iteration, or that fails") {
  CountedRun run;
  run.figures.overshoot = latency(0.0, 10.0);
  run.figures.iteration = latency(59.0, 59.0);
  const auto verdict = [&run] {
    return verdict_of(judge_realtime({{}, {&run, 1}, {}, nullptr}), "past the budget");
  };
  CHECK(verdict() == Verdict::kMet);
  run.figures.overshoot = latency(0.0, 59.0);
  CHECK(verdict() == Verdict::kFailed);
}

TEST_CASE("a program has this one's environment, with what it is given in the place of the same names") {
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

TEST_CASE("a run without a report of its watch is not measured, and says why") {
  const TemporaryFolder folder;
  const auto watch = read_thread_watch(folder.file(""));
  REQUIRE_FALSE(watch.ok());
  // As the library is or is not built beside the test.
  const bool is_known = watch.error().message.find("is not beside this program") != std::string::npos ||
                        watch.error().message.find("before it was warm") != std::string::npos;
  CHECK(is_known);
}
