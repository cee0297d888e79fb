#include "nilio/core/compute_budget.hpp"

#include "nilio/core/odometry.hpp"
#include "nilio/core/odometry_runtime.hpp"

#include "tests/support/synthetic_room.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio::core;
using nilio::tests::Room;
using nilio::tests::scan_room;

namespace {

constexpr double kScanIntervalS = 0.1;
constexpr std::size_t kFirstScans = 5;  // not limited

SE3 driving(double t) {
  const double yaw = 0.15 * std::sin(0.8 * t);
  return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Vector3::UnitZ())), Vector3(8.0 * t, 0.5 * yaw, 0.0)};
}

/// A clock that advances by work only: each unit of a kind costs a fixed number of nanoseconds.
struct WorkClock {
  const ComputeBudget* budget = nullptr;
  std::array<double, kWorkKindCount> cost_ns{};
};
WorkClock work_clock;

std::int64_t read_work_clock() {
  if (work_clock.budget == nullptr) return 1;
  double time = 1.0;
  for (std::size_t i = 0; i < kWorkKindCount; ++i)
    time += work_clock.cost_ns[i] * static_cast<double>(work_clock.budget->work_done()[i]);
  return static_cast<std::int64_t>(time);
}

struct BudgetRun {
  std::vector<OdometryResult> results;
  std::vector<BudgetDecisions> decisions;
  std::vector<std::int64_t> overshoot_ns;
  std::int64_t dearest_iteration_ns = 0;
  double end_error_m = 0.0;
};

BudgetRun budgeted_drive(const BudgetConfig& budget, int scans,
                         const std::vector<BudgetDecisions>* repeat = nullptr,
                         Odometry::ClockFunction clock = nullptr,
                         CoarsePolicy coarse = OdometryConfig{}.coarse) {
  static const Room room = Room::with_pillars();
  OdometryConfig config;
  config.budget = budget;
  config.coarse = coarse;
  Odometry odometry(config, clock);
  OdometryRuntime runtime(odometry);
  work_clock.budget = clock != nullptr ? &runtime.budget() : nullptr;
  BudgetRun run;
  for (int i = 0; i < scans; ++i) {
    const Scan scan = scan_room(room, driving, i * kScanIntervalS, static_cast<std::uint64_t>(i));
    OdometryResult result = repeat != nullptr
                                ? runtime.register_scan(scan, (*repeat)[static_cast<std::size_t>(i)])
                                : odometry.register_scan(scan);
    run.overshoot_ns.push_back(runtime.budget().overshoot_ns());
    runtime.note_published(result);
    odometry.update_map(result);
    run.dearest_iteration_ns = std::max(run.dearest_iteration_ns, runtime.budget().iteration_ns());
    run.decisions.push_back(runtime.budget().decisions());
    run.results.push_back(result);
  }
  work_clock.budget = nullptr;
  const SE3 truth = driving(kScanIntervalS).inverse() * driving(scans * kScanIntervalS);
  const SE3 estimate = run.results.front().T_odom_base.inverse() * run.results.back().T_odom_base;
  run.end_error_m = (truth.translation - estimate.translation).norm();
  return run;
}

BudgetConfig ops(double budget_ms) { return {BudgetMode::kOps, Duration::from_milliseconds(budget_ms)}; }

std::size_t count_level(const BudgetRun& run, DegradationLevel degradation_level) {
  return static_cast<std::size_t>(
      std::count_if(run.results.begin(), run.results.end(),
                    [&](const auto& result) { return result.degradation_level == degradation_level; }));
}

bool same_poses(const BudgetRun& a, const BudgetRun& b) {
  return std::equal(a.results.begin(), a.results.end(), b.results.begin(), b.results.end(),
                    [](const OdometryResult& x, const OdometryResult& y) {
                      return x.T_odom_base.translation == y.T_odom_base.translation &&
                             x.T_odom_base.rotation.coeffs() == y.T_odom_base.rotation.coeffs() &&
                             x.pose_covariance == y.pose_covariance;
                    });
}

}  // namespace

TEST_CASE(
    "counted work keeps every budget: one pose a scan, none late, and the degradation levels worsen in order",
    "[compute_budget]") {
  for (const double budget_ms : {50.0, 2.0, 1.0, 0.5, 0.3, 0.15}) {
    INFO("budget " << budget_ms << " ms");
    const BudgetRun run = budgeted_drive(ops(budget_ms), 30);
    CHECK(run.results.size() == 30);
    for (std::size_t i = kFirstScans; i < run.results.size(); ++i) CHECK(run.overshoot_ns[i] <= 0);
    if (budget_ms >= 50.0) CHECK(count_level(run, DegradationLevel::kFull) == 30);
    if (budget_ms <= 1.0) CHECK(count_level(run, DegradationLevel::kFewerPoints) >= 20);
    if (budget_ms >= 0.3) CHECK(run.end_error_m < 0.2);
  }
}

TEST_CASE("with no time for an iteration the pose is the prediction, and is marked so", "[compute_budget]") {
  const BudgetRun run = budgeted_drive(ops(0.07), 12);
  for (std::size_t i = kFirstScans; i < run.results.size(); ++i) {
    CHECK(run.results[i].degradation_level == DegradationLevel::kPredictionOnly);
    CHECK(run.results[i].stop_reason == StopReason::kBudget);
    CHECK(run.results[i].predicted);
  }
  CHECK(run.results.back().pose_covariance.trace() > run.results[kFirstScans].pose_covariance.trace());
  CHECK(run.end_error_m < 0.5);
}

TEST_CASE("a generous budget changes no bit of the result", "[compute_budget]") {
  CHECK(same_poses(budgeted_drive(ops(1000.0), 15), budgeted_drive({}, 15)));
}

TEST_CASE("with a clock that follows the work, the deadline is missed by less than an iteration",
          "[compute_budget]") {
  // Half, once and three times the nominal cost.
  for (const double factor : {0.5, 1.0, 3.0}) {
    for (const double budget_ms : {2.0, 1.0, 0.5}) {
      INFO("factor " << factor << ", budget " << budget_ms << " ms");
      work_clock.cost_ns = {20.0 * factor, 130.0 * factor, 60.0 * factor, 60'000.0 * factor};
      const BudgetRun run = budgeted_drive({BudgetMode::kWall, Duration::from_milliseconds(budget_ms)}, 40,
                                           nullptr, read_work_clock);
      std::vector<std::int64_t> late(run.overshoot_ns.begin() + kFirstScans, run.overshoot_ns.end());
      CHECK(late.size() == 35);
      // The cost estimates settle in the first limited scans.
      for (std::size_t i = 10; i < late.size(); ++i) CHECK(late[i] < run.dearest_iteration_ns);
    }
  }
}

TEST_CASE("the decisions of a run by the clock repeat it bit for bit", "[compute_budget]") {
  work_clock.cost_ns = {35.0, 200.0, 110.0, 80'000.0};
  const BudgetRun first =
      budgeted_drive({BudgetMode::kWall, Duration::from_milliseconds(0.6)}, 25, nullptr, read_work_clock);
  CHECK(count_level(first, DegradationLevel::kFull) < 10);
  const BudgetRun repeated = budgeted_drive({}, 25, &first.decisions);
  CHECK(same_poses(first, repeated));
  for (std::size_t i = kFirstScans; i < first.results.size(); ++i)
    CHECK(first.results[i].degradation_level == repeated.results[i].degradation_level);
}

TEST_CASE("the decisions of a run without a budget repeat it, too", "[compute_budget]") {
  const BudgetRun first = budgeted_drive({}, 15);
  const BudgetRun repeated =
      budgeted_drive({BudgetMode::kOps, Duration::from_milliseconds(0.5)}, 15, &first.decisions);
  CHECK(same_poses(first, repeated));
}

TEST_CASE("without decisions a run by the clock gives other poses", "[compute_budget]") {
  work_clock.cost_ns = {35.0, 200.0, 110.0, 80'000.0};
  const BudgetRun first =
      budgeted_drive({BudgetMode::kWall, Duration::from_milliseconds(0.6)}, 25, nullptr, read_work_clock);
  CHECK_FALSE(same_poses(first, budgeted_drive({}, 25)));
}

TEST_CASE("for any answers of a clock each scan has a pose", "[compute_budget]") {
  std::mt19937 random(5);
  const auto below = [&](unsigned end) { return static_cast<unsigned>(random() % end); };
  constexpr std::array<std::uint32_t, 6> kPoints{0, 0, 1, 60, 2000, 35'000};
  for (int run = 0; run < 12; ++run) {
    INFO("run " << run);
    std::vector<BudgetDecisions> decisions(25);
    for (BudgetDecisions& scan : decisions) {
      scan.count_size = static_cast<std::uint8_t>(1 + below(2));
      for (std::uint8_t i = 0; i < scan.count_size; ++i) scan.counts[i] = kPoints[below(kPoints.size())];
      scan.stop_size = static_cast<std::uint8_t>(below(4));
      std::uint16_t question = 0;
      for (std::uint8_t i = 0; i < scan.stop_size; ++i)
        scan.stops[i] = question = static_cast<std::uint16_t>(question + below(3) + (i > 0 ? 1 : 0));
    }
    const BudgetRun cut =
        budgeted_drive({BudgetMode::kWall, Duration::from_milliseconds(1.0)}, 25, &decisions, nullptr,
                       run % 2 == 0 ? CoarsePolicy::kAlways : CoarsePolicy::kAuto);
    CHECK(cut.results.size() == decisions.size());
    for (const OdometryResult& result : cut.results) CHECK(result.T_odom_base.is_finite());
  }
}

TEST_CASE("a budget denies all queries after its last recorded stop", "[compute_budget]") {
  ComputeBudget budget(ops(0.01), nullptr);
  budget.begin_scan(0, false);
  for (int i = 0; i < 200; ++i) CHECK_FALSE(budget.allows(WorkKind::kNdt, 1'000'000));
  CHECK(budget.decisions().stop_size == BudgetDecisions::kMaxStops);
  ComputeBudget repeated({}, nullptr);
  repeated.begin_scan(budget.decisions(), false);
  for (int i = 0; i < 200; ++i) CHECK_FALSE(repeated.allows(WorkKind::kNdt, 1));
}

TEST_CASE("an exempt scan is limited in its number of hypotheses only, and repeats it", "[compute_budget]") {
  ComputeBudget budget(ops(0.01), nullptr);
  budget.begin_scan(0, true, Duration::from_milliseconds(1.0));
  int begun = 0;
  while (budget.allows_hypothesis() && begun < 100) {
    ++begun;
    CHECK(budget.choose_registration_points(1000, true) == 1000);
    for (int i = 0; i < 5; ++i) CHECK(budget.allows(WorkKind::kIcp, 1000));
    budget.record(WorkKind::kIcp, 5000);
  }
  // An iteration of 1000 points takes 60 us.
  CHECK(begun == 4);
  ComputeBudget repeated({}, nullptr);
  repeated.begin_scan(budget.decisions(), true);
  for (int i = 0; i < 4; ++i) CHECK(repeated.allows_hypothesis());
  CHECK_FALSE(repeated.allows_hypothesis());
  CHECK(repeated.allows(WorkKind::kIcp, 1000));
}

TEST_CASE("a run on a computer too slow for the initial velocity search is repeated", "[compute_budget]") {
  work_clock.cost_ns = {500.0, 4000.0, 2000.0, 80'000.0};
  const BudgetRun slow =
      budgeted_drive({BudgetMode::kWall, Duration::from_milliseconds(50.0)}, 12, nullptr, read_work_clock);
  const BudgetRun fast = budgeted_drive({}, 12);
  CHECK(slow.results[1].coarse_iterations < fast.results[1].coarse_iterations);
  CHECK(slow.results[1].coarse_iterations > 0);
  CHECK(same_poses(slow, budgeted_drive({}, 12, &slow.decisions)));
}

TEST_CASE("work skipped as too expensive is tried again", "[compute_budget]") {
  work_clock.cost_ns = {20.0, 130.0, 60.0, 60'000.0};
  ComputeBudget budget({BudgetMode::kWall, Duration::from_milliseconds(1.0)}, read_work_clock);
  work_clock.budget = &budget;
  work_clock.cost_ns[static_cast<std::size_t>(WorkKind::kPrepare)] = 5000.0;
  for (int i = 0; i < 20; ++i) {
    budget.begin_scan(0, false);
    if (const std::size_t points = budget.choose_scan_points(30000); points > 0)
      budget.record(WorkKind::kPrepare, points);
  }
  work_clock.cost_ns[static_cast<std::size_t>(WorkKind::kPrepare)] = 20.0;
  std::size_t points = 0;
  for (int i = 0; i < 40; ++i) {
    budget.begin_scan(0, false);
    points = budget.choose_scan_points(30000);
    if (points > 0) budget.record(WorkKind::kPrepare, points);
  }
  CHECK(points > 5000);
  work_clock.budget = nullptr;
}

TEST_CASE("one preempted measurement changes the cost estimate by a bounded factor", "[compute_budget]") {
  work_clock.cost_ns = {20.0, 130.0, 60.0, 60'000.0};
  ComputeBudget budget({BudgetMode::kWall, Duration::from_milliseconds(10.0)}, read_work_clock);
  work_clock.budget = &budget;
  budget.begin_scan(0, false);
  work_clock.cost_ns[static_cast<std::size_t>(WorkKind::kIcp)] = 60'000.0;
  budget.record(WorkKind::kIcp, 100);
  CHECK(budget.cost_ns(WorkKind::kIcp) < 120.0);
  work_clock.budget = nullptr;
}

TEST_CASE("the scan after a gap may take half of the time to the next one, and tracking may not",
          "[compute_budget]") {
  static const Room room = Room::with_pillars();
  OdometryConfig config;
  config.budget = ops(1.0);
  Odometry odometry(config);
  OdometryRuntime runtime(odometry);
  constexpr int kGapBefore = 15;
  for (int i = 0; i < 30; ++i) {
    const double start_s = (i < kGapBefore ? i : i + 8) * kScanIntervalS;
    OdometryResult result =
        odometry.register_scan(scan_room(room, driving, start_s, static_cast<std::uint64_t>(i)));
    INFO("scan " << i);
    if (i >= static_cast<int>(kFirstScans) && i < kGapBefore) CHECK(result.recovery_budget.ns == 0);
    if (i == kGapBefore) {
      CHECK(result.recovery_budget.seconds() == Approx(0.5 * kScanIntervalS).epsilon(0.01));
      CHECK(result.degradation_level == DegradationLevel::kFull);
    }
    if (i == 29) CHECK(result.state == TrackingState::kTracking);
    runtime.note_published(result);
    odometry.update_map(result);
  }
}
