#include "tools/bench/odometry/consistency.hpp"

#include <cstdint>
#include <random>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::bench;
using core::Duration;
using core::Matrix6;
using core::OdometryResult;
using core::SE3;
using core::Time;
using core::Vector6;

namespace {

constexpr std::size_t kScans = 4000;
constexpr Duration kPeriod = Duration::from_milliseconds(100.0);
constexpr Duration kTruthPeriod = Duration::from_milliseconds(10.0);
const Time kBegin{1'767'268'800'000'000'000};

/// Constant twist with motion about and along every axis.
const Vector6 kTwist = (Vector6() << 8.0, 0.5, 0.2, 0.02, -0.01, 0.3).finished();

SE3 true_pose(Time time) { return core::se3_exp((time - kBegin).seconds() * kTwist); }

Trajectory truth() {
  Trajectory result;
  for (Time time = kBegin; time <= kBegin + kPeriod * static_cast<std::int64_t>(kScans + 1);
       time = time + kTruthPeriod) {
    result.stamps.push_back(time);
    Pose pose = Pose::Identity();
    pose.linear() = true_pose(time).rotation.toRotationMatrix();
    pose.translation() = true_pose(time).translation;
    result.poses.push_back(pose);
  }
  return result;
}

/// Errors of different size along each axis of the body, correlated between two of them.
Matrix6 body_covariance() {
  Vector6 sigma;
  sigma << 0.02, 0.01, 0.005, 1e-3, 5e-4, 2e-4;
  Matrix6 covariance = sigma.cwiseAbs2().asDiagonal();
  covariance(0, 5) = covariance(5, 0) = 0.6 * sigma[0] * sigma[5];
  return covariance;
}

/// Poses and twists with errors drawn from a covariance. They report `factor` times that covariance.
std::vector<OdometryResult> drawn_results(double factor) {
  std::mt19937_64 generator(7);
  std::normal_distribution<double> normal;
  const Matrix6 root = body_covariance().llt().matrixL();
  const auto draw = [&]() -> Vector6 {
    Vector6 white;
    for (double& value : white) value = normal(generator);
    return root * white;
  };
  std::vector<OdometryResult> results(kScans);
  for (std::size_t i = 0; i < kScans; ++i) {
    OdometryResult& result = results[i];
    result.scan_start = kBegin + kPeriod * static_cast<std::int64_t>(i);
    result.scan_end = result.scan_start + kPeriod;
    result.state = core::TrackingState::kTracking;
    result.T_odom_base = true_pose(result.scan_end) * core::se3_exp(draw());
    const Matrix6 to_odom = core::block_rotation(result.T_odom_base.rotation.toRotationMatrix());
    result.pose_covariance = factor * to_odom * body_covariance() * to_odom.transpose();
    result.twist = kTwist + draw();
    result.twist_covariance = factor * body_covariance();
  }
  return results;
}

}  // namespace

TEST_CASE("errors drawn from the reported covariance have a NEES of one", "[consistency]") {
  const Consistency consistency = evaluate_consistency(truth(), drawn_results(1.0));
  for (const Nees& nees : {consistency.step, consistency.second, consistency.twist}) {
    CHECK(nees.count > kScans - 12);
    CHECK(nees.mean == Approx(1.0).margin(0.04));
    CHECK(nees.within_95 == Approx(0.95).margin(0.015));
  }
}

TEST_CASE("covariances four times too large or too small give a NEES of a quarter or four", "[consistency]") {
  const Consistency cautious = evaluate_consistency(truth(), drawn_results(4.0));
  CHECK(cautious.step.mean == Approx(0.25).margin(0.01));
  CHECK(cautious.twist.mean == Approx(0.25).margin(0.01));
  CHECK(cautious.step.within_95 > 0.999);
  const Consistency bold = evaluate_consistency(truth(), drawn_results(0.25));
  CHECK(bold.second.mean == Approx(4.0).margin(0.16));
  CHECK(bold.second.within_95 < 0.6);
}

TEST_CASE("rejected scans, and truths without poses inside a sweep, are left out", "[consistency]") {
  std::vector<OdometryResult> results = drawn_results(1.0);
  results[100].predicted = true;
  results[200].state = core::TrackingState::kInitialising;
  const Consistency consistency = evaluate_consistency(truth(), results);
  CHECK(consistency.twist.count == kScans - 2);
  CHECK(consistency.step.count == kScans - 1 - 4);
  Trajectory kitti = truth();
  kitti.format = TrajectoryFormat::kKitti;
  kitti.stamps.clear();
  CHECK(evaluate_consistency(kitti, results).twist.count == 0);
}
