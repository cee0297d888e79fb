#include "tools/bench/matrix/run_figures.hpp"

#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::bench;
using core::SE3;
using core::Time;
using core::TrackingState;
using core::Vector3;

namespace {

constexpr double kSpeed = 10.0;
constexpr double kPeriod = 0.1;
const Time kBegin{1'767'268'800'000'000'000};

Time stamp_of(int i) { return kBegin + core::Duration::from_seconds(kPeriod * i); }
SE3 truth_at(int i) { return {Eigen::Quaterniond::Identity(), Vector3(kSpeed * kPeriod * i, 0.0, 0.0)}; }

/// 20 s straight ahead without an error, tracking all the time.
std::vector<CheckedPose> perfect_drive() {
  std::vector<CheckedPose> poses;
  for (int i = 0; i <= 200; ++i) poses.push_back({stamp_of(i), truth_at(i), truth_at(i), true});
  return poses;
}

/// Adds an offset to the poses from `first` on.
void shift(std::vector<CheckedPose>& poses, std::size_t first, const Vector3& offset) {
  for (std::size_t i = first; i < poses.size(); ++i) poses[i].estimate.translation += offset;
}

}  // namespace

TEST_CASE("a perfect drive has no silent error, no drift and needs no recovery", "[run_figures]") {
  const RunFigures figures = measure_poses(perfect_drive());
  CHECK(figures.failure.empty());
  CHECK(figures.path_m == Approx(200.0));
  CHECK(figures.drift_percent == Approx(0.0).margin(1e-9));
  CHECK(figures.silent_error_s == 0.0);
  CHECK(figures.recovery_s == 0.0);
  CHECK(is_success(figures, 1.0));
}

TEST_CASE("a jump while tracking is a silent error for the second that contains it", "[run_figures]") {
  auto poses = perfect_drive();
  // 10 m in a second: 0.10 m + 2 % = 0.30 m are allowed.
  shift(poses, 100, Vector3(0.0, 0.31, 0.0));
  CHECK(silent_error_seconds(poses) == Approx(1.0));
  CHECK(describe_failure(measure_poses(poses), 100.0) == "silent error");

  auto small = perfect_drive();
  shift(small, 100, Vector3(0.0, 0.29, 0.0));
  CHECK(silent_error_seconds(small) == 0.0);
}

TEST_CASE("a rotation of more than a degree a second is a silent error", "[run_figures]") {
  const auto turned = [](double degrees) {
    auto poses = perfect_drive();
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(degrees * M_PI / 180.0, Vector3::UnitZ()));
    for (std::size_t i = 100; i < poses.size(); ++i) {
      // About the vehicle, so that no position changes.
      poses[i].estimate.rotation = turn;
    }
    return silent_error_seconds(poses);
  };
  CHECK(turned(1.1) == Approx(1.0));
  CHECK(turned(0.9) == 0.0);
}

TEST_CASE("an error that the state announces is not silent, and its recovery is timed", "[run_figures]") {
  auto poses = perfect_drive();
  shift(poses, 100, Vector3(0.0, 5.0, 0.0));
  for (std::size_t i = 100; i < 123; ++i) poses[i].is_tracking = false;
  CHECK(silent_error_seconds(poses) == 0.0);
  CHECK(longest_recovery_seconds(poses) == Approx(2.3));

  // The same with the announcement half a second late: from 10.0 to 10.5 s it was silent.
  for (std::size_t i = 100; i < 105; ++i) poses[i].is_tracking = true;
  CHECK(silent_error_seconds(poses) == Approx(0.5));
}

TEST_CASE("poses before the first tracking one are no loss, and a loss at the end lasts until it",
          "[run_figures]") {
  auto poses = perfect_drive();
  for (std::size_t i = 0; i < 10; ++i) poses[i].is_tracking = false;
  CHECK(longest_recovery_seconds(poses) == 0.0);
  for (std::size_t i = 170; i < poses.size(); ++i) poses[i].is_tracking = false;
  const RunFigures figures = measure_poses(poses);
  CHECK(figures.recovery_s == Approx(3.0));
  CHECK_FALSE(figures.ends_tracking);
}

TEST_CASE("a wrong motion across a gap is silent", "[run_figures]") {
  auto poses = perfect_drive();
  shift(poses, 100, Vector3(2.0, 0.0, 0.0));
  poses.erase(poses.begin() + 70, poses.begin() + 100);
  // The scan after the gap stands for a second, nine more compare with scans before it.
  CHECK(silent_error_seconds(poses) == Approx(1.0 + 0.9).margin(0.11));
}

TEST_CASE("drift is the mean error of the segments in per cent of their length", "[run_figures]") {
  auto poses = perfect_drive();
  for (CheckedPose& pose : poses) pose.estimate.translation *= 1.02;
  const RunFigures figures = measure_poses(poses);
  // Poses are 1 m apart, so that a segment is up to 1 m longer than its nominal length.
  CHECK(figures.drift_percent >= 2.0);
  CHECK(figures.drift_percent < 2.0 * 1.1);
  CHECK(figures.silent_error_s == 0.0);
  CHECK(describe_failure(figures, 1.0) == "drift");
  CHECK(is_success(figures, 2.2));
}

TEST_CASE("a stationary vehicle's drift is its displacement over ten metres", "[run_figures]") {
  std::vector<CheckedPose> poses;
  for (int i = 0; i <= 100; ++i) {
    const SE3 drifted{Eigen::Quaterniond::Identity(), Vector3(0.002 * i, 0.0, 0.0)};
    poses.push_back({stamp_of(i), drifted, SE3{}, true});
  }
  CHECK(measure_poses(poses).drift_percent == Approx(2.0));
}

TEST_CASE("planted errors of one standard deviation give a NEES of one", "[run_figures]") {
  const double sigma = 0.02;
  Trajectory truth;
  std::vector<core::OdometryResult> results;
  for (int i = 0; i <= 300; ++i) {
    truth.stamps.push_back(stamp_of(i));
    truth.poses.emplace_back(truth_at(i).matrix());
    core::OdometryResult result;
    result.scan_end = stamp_of(i);
    result.state = TrackingState::kTracking;
    result.T_odom_base = truth_at(i);
    // The later pose of each pair is off by sqrt(2) sigma along every axis; the pair's covariance is twice
    // sigma squared. Rotations are exact, so that half of the six degrees of freedom have no error.
    if (i % 20 >= 10) result.T_odom_base.translation += Vector3::Constant(std::sqrt(2.0) * sigma);
    result.pose_covariance = core::Matrix6::Identity() * 1e-12;
    result.pose_covariance.topLeftCorner<3, 3>() = core::Matrix3::Identity() * sigma * sigma;
    result.drift_covariance = 4.0 * result.pose_covariance;
    results.push_back(result);
  }
  const RunFigures figures = measure_run(results, truth);
  // Every five seconds of thirty.
  CHECK(figures.nees_count == 6);
  CHECK(figures.nees == Approx(0.5).epsilon(0.01));
  CHECK(figures.tracking == 301);
  // The last pose is exact, the one at 29 s is off by sqrt(2) sigma with four times sigma squared.
  CHECK(figures.drift_nees == Approx(0.0).margin(1e-12));
  results.resize(results.size() - 5);
  CHECK(measure_run(results, truth).drift_nees == Approx(0.25).epsilon(0.01));
}

TEST_CASE("a run without poses in the time of the truth says so", "[run_figures]") {
  auto poses = perfect_drive();
  for (CheckedPose& pose : poses) pose.truth.reset();
  const RunFigures figures = measure_poses(poses);
  CHECK(figures.failure == "fewer than two poses within the time of the truth");
  CHECK(describe_failure(figures, 1.0) == "not run");
}
