#include "daemon/realtime/watchdog.hpp"

#include "tests/support/eventually.hpp"
#include "tests/support/replay_run.hpp"
#include "tests/support/room_drive.hpp"

#include <atomic>
#include <chrono>
#include <thread>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using Catch::Matchers::Contains;

namespace {

constexpr std::int64_t kSecondNs = 1'000'000'000;

}  // namespace

TEST_CASE("a thread without progress for a second hangs once, and its recovery is reported once",
          "[watchdog]") {
  Watchdog watchdog;
  std::uint64_t rounds = 0;
  watchdog.watch("nilio-odometry", [&] { return std::optional(rounds); });
  std::vector<Watchdog::Event> events;
  const auto poll = [&](std::int64_t now_ns) {
    for (Watchdog::Event& event : watchdog.poll(now_ns)) events.push_back(std::move(event));
  };
  for (std::int64_t now = 0; now < 3 * kSecondNs; now += kSecondNs / 10, ++rounds) poll(now);
  CHECK(events.empty());
  for (std::int64_t now = 3 * kSecondNs; now < 6 * kSecondNs; now += kSecondNs / 10) poll(now);
  REQUIRE(events.size() == 1);
  CHECK(events[0].hangs);
  CHECK_THAT(events[0].text, Contains("nilio-odometry: hangs"));
  ++rounds;
  poll(6 * kSecondNs);
  poll(6 * kSecondNs + 1);
  REQUIRE(events.size() == 2);
  CHECK_FALSE(events[1].hangs);
  CHECK_THAT(events[1].text, Contains("progress again after 3"));
  CHECK(watchdog.hangs() == 1);
}

TEST_CASE("neither an ended thread nor a watchdog that slept itself is a hang", "[watchdog]") {
  Watchdog watchdog;
  std::optional<std::uint64_t> rounds = 0;
  watchdog.watch("nilio-lidar", [&] { return rounds; });
  CHECK(watchdog.poll(0).empty());
  rounds = 1;
  CHECK(watchdog.poll(20 * kSecondNs).empty());
  rounds.reset();
  CHECK(watchdog.poll(30 * kSecondNs).empty());
  CHECK(watchdog.poll(60 * kSecondNs).empty());
  CHECK(watchdog.hangs() == 0);
}

TEST_CASE("a hang of the odometry thread alone is named, and the other threads are not", "[watchdog]") {
  const tests::TemporaryFolder folder;
  tests::write_room_drive(folder.path(), tests::s_curve, 4.0, true);
  const auto files = find_replay_files({folder.path().string()});
  REQUIRE(files.ok());
  Config config;
  config.realtime.policy = "other";
  config.realtime.lock_memory = false;
  auto input = open_replay(*files, config);
  REQUIRE(input.ok());
  PipelineOptions options;
  options.rules = RunRules::Kind::kReplayAsLive;
  std::atomic<bool> hangs{false};
  options.observer = [&](const core::Scan& scan, const core::OdometryResult&, const core::Odometry&) {
    hangs = scan.sequence == 10;
    while (hangs) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  };
  auto pipeline = Pipeline::create(config, std::move(input).value(), options, nullptr);
  REQUIRE(pipeline.ok());
  REQUIRE((*pipeline)->start().ok());
  Watchdog watchdog;
  for (const RealtimeThread& thread : (*pipeline)->threads())
    watchdog.watch(name_of(thread.role()), [&thread] { return thread.heartbeat(); });
  std::vector<Watchdog::Event> events;
  const auto poll_until = [&](std::size_t count) {
    return tests::eventually([&] {
      for (Watchdog::Event& event : watchdog.poll(monotonic_ns())) events.push_back(std::move(event));
      return events.size() >= count;
    });
  };
  REQUIRE(poll_until(1));
  CHECK_THAT(events[0].text, Contains("nilio-odometry: hangs"));
  hangs = false;
  REQUIRE(poll_until(2));
  CHECK_THAT(events[1].text, Contains("nilio-odometry: makes progress again"));
  (*pipeline)->request_stop();
  (*pipeline)->join();
  CHECK(events.size() == 2);
}
