#include "daemon/odometry/deadline_guard.hpp"

#include "nilio/core/clock.hpp"

#include "daemon/odometry/decision_log.hpp"
#include "tests/support/room_drive.hpp"

#include <atomic>
#include <chrono>
#include <cstdint>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using daemon::DeadlineGuard;
using daemon::ScanDecision;

namespace {

/// Running guard with the records it published.
struct RunningGuard {
  RunningGuard() {
    auto created = DeadlineGuard::create([this](const ipc::PoseRecord& record) {
      published.push_back(record.sequence);
      calls.fetch_add(1);
    });
    REQUIRE(created.ok());
    guard = std::move(created).value();
    thread = std::thread([this] {
      while (guard->run()) {
      }
    });
  }
  ~RunningGuard() { stop(); }
  void stop() {
    guard->stop();
    if (thread.joinable()) thread.join();
  }

  std::vector<std::uint64_t>
      published;              ///< written by the guard and, after claim(), by the test; never concurrently
  std::atomic<int> calls{0};  ///< calls of the guard's publish function
  std::unique_ptr<DeadlineGuard> guard;
  std::thread thread;
};

ipc::PoseRecord record_of(std::uint64_t sequence) {
  ipc::PoseRecord record;
  record.sequence = sequence;
  return record;
}

constexpr std::int64_t kMillisecond = 1'000'000;

}  // namespace

TEST_CASE("the guard does not publish a pose that is claimed before the deadline", "[deadline_guard]") {
  RunningGuard run;
  for (std::uint64_t i = 0; i < 100; ++i) {
    const std::int64_t deadline = monotonic_ns() + 3'600'000 * kMillisecond;
    run.guard->arm(record_of(i), deadline, deadline);
    CHECK(run.guard->claim());
  }
  run.stop();
  CHECK(run.published.empty());
}

TEST_CASE("the guard publishes an unclaimed pose and records its overshoot", "[deadline_guard]") {
  RunningGuard run;
  const std::int64_t now = monotonic_ns();
  run.guard->arm(record_of(7), now - 5 * kMillisecond, now);
  // Wait until the guard has published; an earlier claim() would be in time.
  while (run.calls.load() == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  CHECK_FALSE(run.guard->claim());
  CHECK(run.published == std::vector<std::uint64_t>{7});
  CHECK(run.guard->published().has_deadline);
  CHECK(run.guard->published().overshoot_ns >= 5 * kMillisecond);
}

TEST_CASE("each scan is published exactly once and in order by either thread", "[deadline_guard]") {
  RunningGuard run;
  constexpr std::uint64_t scans = 3000;
  std::uint64_t by_guard = 0;
  for (std::uint64_t i = 0; i < scans; ++i) {
    // Deadlines around the moment of the claim; only one of the two may publish.
    const bool is_claimed = i % 100 == 0;
    const bool is_left = i % 100 == 50;
    const std::int64_t deadline =
        monotonic_ns() + (is_claimed ? 3'600'000 * kMillisecond : static_cast<std::int64_t>(i % 40) * 10'000);
    const int calls = run.calls.load();
    run.guard->arm(record_of(i), deadline, deadline);
    const std::int64_t claim_at = deadline - 30'000 + static_cast<std::int64_t>(i % 7) * 20'000;
    while (is_left ? run.calls.load() == calls : !is_claimed && monotonic_ns() < claim_at) {
    }
    if (run.guard->claim()) {
      run.published.push_back(i);
    } else {
      ++by_guard;
    }
  }
  run.stop();
  REQUIRE(run.published.size() == scans);
  for (std::uint64_t i = 0; i < scans; ++i) CHECK(run.published[i] == i);
  CHECK(by_guard >= scans / 100);
  CHECK(by_guard <= scans - scans / 100);
}

TEST_CASE("a decision log reads back as written", "[deadline_guard]") {
  const tests::TemporaryFolder folder;
  const std::string path = (folder.path() / "decisions.jsonl").string();
  ScanDecision plain{3, false, false, 12, {}, {}};
  ScanDecision superseded{4, true, false, 12, {}, {}};
  ScanDecision cut{6, false, true, 40, {}, {true, 2, {5000, 0, 0}}};
  cut.budget.counts = {35000, 800, 700, 0};
  cut.budget.count_size = 3;
  cut.budget.stops[0] = 9;
  cut.budget.stop_size = 1;
  {
    std::ofstream file(path);
    file << daemon::decision_line(
                daemon::DecisionHeader{core::BudgetMode::kWall, core::Duration::from_milliseconds(5.0), {}})
         << '\n';
    for (const ScanDecision& decision : {plain, superseded, cut})
      file << daemon::decision_line(decision) << '\n';
  }
  const auto decisions = daemon::read_decisions(path);
  REQUIRE(decisions.ok());
  REQUIRE(decisions->size() == 3);
  CHECK((*decisions)[1].superseded);
  const ScanDecision& last = (*decisions)[2];
  CHECK(last.sequence == 6);
  CHECK(last.guarded);
  CHECK(last.imu_samples == 40);
  CHECK(last.budget.count_size == 3);
  CHECK(last.budget.counts[1] == 800);
  CHECK(last.budget.stop_size == 1);
  CHECK(last.budget.stops[0] == 9);
  CHECK_FALSE((*decisions)[1].merge.merged);
  CHECK(last.merge.merged);
  CHECK(last.merge.lidars == 2);
  CHECK(last.merge.packets[0] == 5000);
}

TEST_CASE("a damaged decision log is rejected with the wrong line", "[deadline_guard]") {
  const tests::TemporaryFolder folder;
  const std::string path = (folder.path() / "decisions.jsonl").string();
  const std::string header = daemon::decision_line(
      daemon::DecisionHeader{core::BudgetMode::kWall, core::Duration::from_milliseconds(5.0), {}});
  const auto read = [&](const std::string& text) {
    std::ofstream(path) << text;
    const auto decisions = daemon::read_decisions(path);
    return decisions.ok() ? std::string() : decisions.error().message;
  };
  CHECK(read("").find(":1:") != std::string::npos);
  CHECK(read("{\"format\": \"other\"}\n").find(":1:") != std::string::npos);
  for (const char* line :
       {"x", "{}", "[1]", R"({"scan": -1, "imu_samples": 0})", R"({"scan": 1, "imu_samples": "2"})",
        R"({"scan": 1, "imu_samples": 0, "points": [1,2,3,4,5]})",
        R"({"scan": 1, "imu_samples": 0, "stops": 4})",
        R"({"scan": 1, "imu_samples": 0, "stops": [70000]})"}) {
    INFO(line);
    CHECK(read(header + "\n" + line + "\n").find(":2:") != std::string::npos);
  }
  const std::string backwards = R"({"scan": 5, "imu_samples": 0})"
                                "\n"
                                R"({"scan": 5, "imu_samples": 0})"
                                "\n";
  CHECK(read(header + "\n" + backwards).find(":3:") != std::string::npos);
  CHECK(daemon::read_decisions((folder.path() / "none").string()).ok() == false);
}
