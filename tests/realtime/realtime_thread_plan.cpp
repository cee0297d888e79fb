#include "daemon/config/schema.hpp"
#include "daemon/odometry/pipeline.hpp"
#include "daemon/realtime/memory_plan.hpp"
#include "tests/support/live_run.hpp"
#include "tests/support/threads.hpp"

#include <sched.h>
#include <string>
#include <sys/types.h>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using tests::may_have_fifo;
using tests::threads_named;

namespace {

bool any_contains(const std::vector<PlanOutcome>& outcomes, bool granted, const std::string& text) {
  return std::any_of(outcomes.begin(), outcomes.end(), [&](const PlanOutcome& outcome) {
    return outcome.granted == granted && outcome.text.find(text) != std::string::npos;
  });
}

struct Started {
  std::unique_ptr<Pipeline> pipeline;
  std::vector<PlanOutcome> outcomes;
};

Config live_config() {
  Config config = tests::live_config({tests::free_port()});
  config.realtime.policy = "fifo";
  return config;
}

Started start(const Config& config) {
  auto input = open_live(config);
  REQUIRE(input.ok());
  auto pipeline =
      Pipeline::create(config, std::move(input).value(), {.rules = RunRules::Kind::kLive}, nullptr);
  REQUIRE(pipeline.ok());
  auto outcomes = (*pipeline)->start();
  REQUIRE(outcomes.ok());
  return {std::move(pipeline).value(), std::move(outcomes).value()};
}

}  // namespace

TEST_CASE("odometry, workers and receive threads have the policy and CPUs of the plan",
          "[realtime_thread_plan][plan]") {
  if (!may_have_fifo()) {
    WARN("skipped: no permission for FIFO threads");
    return;
  }
  const CpuList cpus = scheduling_of(0).cpus;
  Config config = live_config();
  config.odometry.threads = 2;
  config.realtime.lidar_priority = 17;
  config.realtime.odometry_priority = 13;
  config.realtime.lidar_cpus = std::to_string(cpus.front());
  config.realtime.odometry_cpus = std::to_string(cpus.back());
  const Started started = start(config);
  // Workers inherit the name of the thread that started them.
  const std::vector<pid_t> odometry = threads_named("self", "nilio-odometry");
  const std::size_t expected = cpus.size() > 1 ? 2 : 1;
  CHECK(odometry.size() >= expected);
  for (const pid_t thread : odometry)
    CHECK(scheduling_of(thread) == ThreadScheduling{SCHED_FIFO, 13, {cpus.back()}});
  const std::vector<pid_t> receivers = threads_named("self", "nilio-lidar");
  REQUIRE(receivers.size() == 1);
  CHECK(scheduling_of(receivers[0]) == ThreadScheduling{SCHED_FIFO, 17, {cpus.front()}});
  CHECK(any_contains(started.outcomes, true, "nilio-lidar: FIFO 17 on CPU " + config.realtime.lidar_cpus));
  CHECK(any_contains(started.outcomes, true, "FIFO threads"));
}

TEST_CASE("a missing CPU is reported with the key to correct, and is an error in strict mode",
          "[realtime_thread_plan][plan]") {
  Config config = live_config();
  config.realtime.policy = "other";
  config.realtime.odometry_cpus = "1000";
  {
    const Started started = start(config);
    CHECK(any_contains(started.outcomes, false, "CPU 1000 refused"));
    CHECK(any_contains(started.outcomes, false, "correct realtime.odometry_cpus"));
    CHECK(any_contains(started.outcomes, true, "nilio-lidar: normal scheduling"));
  }
  // Some of the CPUs exist: the kernel would silently ignore the others.
  config.realtime.odometry_cpus = std::to_string(scheduling_of(0).cpus.front()) + ",1000";
  {
    const Started started = start(config);
    CHECK(any_contains(started.outcomes, false, "not all available, only"));
  }
  config.realtime.strict = true;
  auto input = open_live(config);
  REQUIRE(input.ok());
  auto pipeline =
      Pipeline::create(config, std::move(input).value(), {.rules = RunRules::Kind::kLive}, nullptr);
  REQUIRE(pipeline.ok());
  const auto outcomes = (*pipeline)->start();
  REQUIRE_FALSE(outcomes.ok());
  CHECK(outcomes.error().message.find("realtime.strict: nilio-odometry") != std::string::npos);
}

TEST_CASE("an invalid CPU list is an error with its key", "[realtime_thread_plan][plan]") {
  Config config = live_config();
  config.realtime.imu_cpus = "1-x";
  const auto plan = make_thread_plan(config, RunRules::Kind::kLive);
  REQUIRE_FALSE(plan.ok());
  CHECK(plan.error().message.find("realtime.imu_cpus: '1-x'") == 0);
}

TEST_CASE("a supervisor without a CPU of its own causes a warning", "[realtime_thread_plan][plan]") {
  Config config;
  const CpuList cpus = scheduling_of(0).cpus;
  config.odometry.threads = static_cast<int>(cpus.size());
  CHECK(check_throttling(make_thread_plan(config, RunRules::Kind::kLive).value()).warns);
  CHECK_FALSE(check_throttling(make_thread_plan(config, {}).value()).warns);
  if (cpus.size() < 2) return;
  config.realtime.odometry_cpus = std::to_string(cpus.back());
  CHECK_FALSE(check_throttling(make_thread_plan(config, RunRules::Kind::kLive).value()).warns);
}

TEST_CASE("a worker with other scheduling than the odometry is reported with both",
          "[realtime_thread_plan][plan]") {
  const ThreadPlan plan = make_thread_plan(Config{}, {}).value();
  CHECK(check_workers(plan, {gettid()}).granted);
  if (!may_have_fifo()) {
    WARN("skipped: no permission for FIFO threads");
    return;
  }
  std::atomic<pid_t> other{0};
  std::atomic<bool> over{false};
  std::thread thread([&] {
    const sched_param fifo{11};
    sched_setscheduler(0, SCHED_FIFO, &fifo);
    other.store(gettid());
    while (!over.load()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  });
  while (other.load() == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  const PlanOutcome outcome = check_workers(plan, {other.load()});
  over.store(true);
  thread.join();
  CHECK_FALSE(outcome.granted);
  CHECK(outcome.text.find("has FIFO 11") != std::string::npos);
  CHECK(outcome.text.find("instead of normal scheduling") != std::string::npos);
}
