#include "core/src/map/map_drift.hpp"

#include <cmath>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;

namespace {

constexpr double kSigma = 0.005;
const Matrix6 kIdentity = Matrix6::Identity();
const Matrix6 kZero = Matrix6::Zero();
const Matrix6 kPoseCovariance = kSigma * kSigma * kIdentity;

SE3 at_metres(double x) { return {Eigen::Quaterniond::Identity(), Vector3(x, 0.0, 0.0)}; }

/// Variance of one axis after scans of one place, all of which the map takes.
double variance_after(int scans, double share, double gain) {
  MapDrift drift;
  for (int i = 0; i < scans; ++i) {
    drift.follow({}, share * kIdentity, gain * kIdentity);
    drift.take({}, kPoseCovariance);
  }
  return drift.at({})(0, 0);
}

/// The same by simulation: the map follows the scans that it takes, the pose follows the map by its gain, and
/// noise keeps its deviation against the map.
double simulated_variance_after(int scans, double share, double gain) {
  std::mt19937 random{11};
  std::normal_distribution<double> normal;
  const double kept = (1.0 - gain) * (1.0 - share);
  const double noise = kSigma * std::sqrt(1.0 - kept * kept);
  constexpr int kRuns = 4000;
  double square = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    double map = 0.0;
    double pose_in_map = kSigma * normal(random);
    for (int i = 1; i < scans; ++i) {
      map += share * pose_in_map;
      pose_in_map = kept * pose_in_map + noise * normal(random);
    }
    square += map * map / kRuns;
  }
  return square;
}

}  // namespace

TEST_CASE("the drift of a map is that of a simulation, whether errors of poses last or not", "[map_drift]") {
  for (const double share : {0.02, 0.1, 0.5}) {
    for (const double gain : {0.1, 0.5, 1.0}) {
      INFO("share " << share << ", gain " << gain);
      CHECK(variance_after(200, share, gain) ==
            Approx(simulated_variance_after(200, share, gain)).epsilon(0.08));
    }
  }
}

TEST_CASE("a new map has the whole error of the pose at which it begins, and no other", "[map_drift]") {
  MapDrift drift;
  drift.take(at_metres(10.0), kPoseCovariance);
  drift.follow(at_metres(10.0), kIdentity, kZero);
  CHECK((drift.at(at_metres(10.0)) - kPoseCovariance).norm() < 1e-12);
  drift.take(at_metres(10.0), kPoseCovariance);
  drift.follow(at_metres(10.0), kIdentity, kZero);
  CHECK((drift.at(at_metres(10.0)) - 2.0 * kPoseCovariance).norm() < 1e-12);
}

TEST_CASE("an error of heading grows to one of position with the way that follows", "[map_drift]") {
  MapDrift drift;
  drift.take({}, kPoseCovariance);
  drift.follow({}, kIdentity, kZero);
  const Matrix6 far = drift.at(at_metres(100.0));
  CHECK(std::sqrt(far(1, 1)) == Approx(std::hypot(100.0 * kSigma, kSigma)));
  CHECK(std::sqrt(far(0, 0)) == Approx(kSigma));
  CHECK(std::sqrt(far(5, 5)) == Approx(kSigma));
}

TEST_CASE("scans that the map does not take, as of a stationary vehicle, do not move it", "[map_drift]") {
  MapDrift drift;
  drift.take({}, kPoseCovariance);
  drift.follow({}, 0.1 * kIdentity, 0.5 * kIdentity);
  const Matrix6 before = drift.at({});
  CHECK(before.trace() > 0.0);
  for (int i = 0; i < 100; ++i) drift.follow({}, 0.1 * kIdentity, 0.5 * kIdentity);
  CHECK(drift.at({}) == before);
}
