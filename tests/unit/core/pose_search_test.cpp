#include "core/src/recovery/pose_search.hpp"

#include "tests/support/sweep_of_scan.hpp"
#include "tests/support/synthetic_room.hpp"

#include <algorithm>

#include <catch2/catch.hpp>

using namespace nilio::core;
using nilio::tests::Room;
using nilio::tests::scan_room;
using nilio::tests::sweep_of;
using nilio::tests::TestSweep;

namespace {

SE3 pose(double x, double yaw = 0.0) { return {so3_exp(Vector3(0.0, 0.0, yaw)), Vector3(x, 0.3, 0.0)}; }

Scan scan_from(const SE3& T_room_base, int i) {
  Scan scan = scan_room(
      Room::with_pillars(), [&](double) { return T_room_base; }, 0.1 * i, static_cast<std::uint64_t>(i));
  scan.motion_compensated = true;
  return scan;
}

constexpr std::size_t kStep = 3;

/// A map of the hall from its origin, and the search in it.
struct Search {
  OdometryConfig config;
  ComputeBudget budget;
  MotionEstimator motion{config};
  LocalMap map{config, false};
  NdtIcp ndt_icp{config, budget, {}};
  PoseSearch search{config, ndt_icp, budget};
  OdometryResult result;

  explicit Search(const BudgetConfig& budget_config = {}) : budget(budget_config, nullptr) {
    map.reset(1.5);
    for (int i = 0; i < 3; ++i) {
      const TestSweep scan = sweep_of(scan_from(pose(0.4 * i), i), kStep);
      map.insert(scan.sweep, scan.points, pose(0.4 * i), kCoarseVoxelMetres);
    }
    budget.begin_scan(0, false);
    motion.start(scan_from(pose(0.0), 0));
    motion.place_first_sweep(motion.prior().span);
    motion.finish(0);
    motion.predict(scan_from(pose(0.0), 1));
  }
};

double distance(const FoundPose& found, const SE3& truth) {
  return (found.T_map_middle.translation - truth.translation).norm();
}

}  // namespace

TEST_CASE("a lost vehicle is found beside the prediction", "[pose_search]") {
  for (const SE3& truth : {pose(5.0), pose(-5.0), pose(1.0, 0.4), pose(0.5, -0.4)}) {
    CAPTURE(truth.translation.x());
    Search s;
    const FoundPose found =
        s.search.relocalize(sweep_of(scan_from(truth, 1), kStep).sweep, s.map, s.motion, s.result);
    CHECK(distance(found, truth) < 0.05);
    CHECK(s.search.has_tried_all());
  }
}

TEST_CASE("hypotheses for which there is no time are tried with the next scans", "[pose_search]") {
  BudgetConfig little;
  little.mode = BudgetMode::kOps;
  little.budget = Duration::from_milliseconds(4.0);
  Search s(little);
  const std::vector<SweepPoint> sweep = sweep_of(scan_from(pose(-5.0), 1), kStep).sweep;
  int calls = 0;
  double nearest = 1e9;
  do {
    s.budget.begin_scan(0, false);
    const FoundPose found = s.search.relocalize(sweep, s.map, s.motion, s.result);
    nearest = std::min(nearest, distance(found, pose(-5.0)));
    REQUIRE(++calls < 50);
  } while (nearest > 0.05);
  CHECK(calls > 1);
}

TEST_CASE("at an unknown speed the second scan is found at its place, and at each place once",
          "[pose_search]") {
  for (const double speed : {-17.0, 0.0, 4.0, 14.0, 33.0, 47.0}) {
    CAPTURE(speed);
    Search s;
    const SE3 truth = pose(0.1 * speed);
    const auto found =
        s.search.find_displacements(sweep_of(scan_from(truth, 1), kStep).sweep, s.map, s.motion, s.result);
    REQUIRE_FALSE(found.empty());
    const auto apart = [](const SE3& a, const SE3& b) { return (a.translation - b.translation).norm(); };
    CHECK(std::any_of(found.begin(), found.end(),
                      [&](const SE3& at) { return apart(at, truth) < PoseSearch::kDeviationMetres; }));
    for (std::size_t i = 0; i < found.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) CHECK(apart(found[i], found[j]) >= PoseSearch::kDeviationMetres);
    }
  }
}

TEST_CASE("a second scan that registers nowhere is where it was predicted", "[pose_search]") {
  Search s;
  s.map.reset(1.5);
  const auto found =
      s.search.find_displacements(sweep_of(scan_from(pose(1.0), 1), kStep).sweep, s.map, s.motion, s.result);
  REQUIRE(found.size() == 1);
  CHECK(found.front().translation == s.motion.T_predicted().translation);
}
