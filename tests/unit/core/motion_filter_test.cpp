#include "core/src/estimation/motion_filter.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;

namespace {

constexpr double kStep = 0.1;
constexpr double kScanDeviation = 0.01;
constexpr double kForceDeviation = 0.1;

/// A vehicle whose velocity and gravity-and-bias err by the filter's initial variances, corrected by scans of
/// the given noise.
struct Error {
  Vector3 place = Vector3::Zero();
  Vector3 velocity = Vector3::Zero();
  Vector3 gravity_bias = Vector3::Zero();
};

struct Trial {
  Error error;
  double gravity_bias_variance = 0.0;
};

Trial corrected_by_scans(const MotionFilter::Variances& variances, int scans, bool shown, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const auto noise = [&] { return Vector3(normal(random), normal(random), normal(random)); };
  const Matrix3 R = so3_exp(Vector3(0.1, -0.2, 0.7)).toRotationMatrix();
  MotionFilter filter;
  filter.begin(variances);
  Trial trial;
  Error& error = trial.error;  // estimate less truth
  error.velocity = std::sqrt(variances.velocity) * noise();
  error.gravity_bias = std::sqrt(variances.gravity_bias) * noise();
  for (int i = 0; i < scans; ++i) {
    const Vector3 wrong = error.gravity_bias + kForceDeviation * noise();
    error.place += kStep * error.velocity - 0.5 * kStep * kStep * wrong;
    error.velocity -= kStep * wrong;
    filter.advance(kStep, 0.0);
    const Vector3 prior = filter.position_variance(R);
    Vector3 share = Vector3::Zero();
    if (shown) share = prior.array() / (prior.array() + kScanDeviation * kScanDeviation);
    const Vector3 seen = -(R.transpose() * error.place) + kScanDeviation * noise();
    const Vector3 moved = share.cwiseProduct(seen);
    const Vector3 gain = filter.velocity_gain(R);
    error.place += R * moved;
    error.velocity += R * gain.cwiseProduct(moved);
    error.gravity_bias += filter.correct(R, moved, share);
  }
  trial.gravity_bias_variance = filter.gravity_bias_variance();
  return trial;
}

}  // namespace

TEST_CASE("scans estimate the accelerometer's bias within the filter's covariance", "[motion_filter]") {
  constexpr int kTrials = 200;
  double squares = 0.0;
  double variances = 0.0;
  for (unsigned seed = 1; seed <= kTrials; ++seed) {
    const Trial trial = corrected_by_scans({0.3 * 0.3, 0.5 * 0.5}, 50, true, seed);
    CHECK(trial.error.gravity_bias.norm() < 0.4);
    CHECK(trial.error.velocity.norm() < 0.2);
    squares += trial.error.gravity_bias.squaredNorm() / 3.0;
    variances += trial.gravity_bias_variance;
  }
  CHECK(squares < 1.5 * variances);
  CHECK(squares > 0.5 * variances);
}

TEST_CASE("unobserving scans leave velocity and gravity-and-bias to the accelerometer", "[motion_filter]") {
  const Trial trial = corrected_by_scans({0.0, 0.0}, 50, false, 1);
  CHECK(trial.error.gravity_bias.norm() == 0.0);
  // Fifty steps, each wrong by that.
  CHECK(trial.error.velocity.norm() < 3.0 * kForceDeviation * kStep * std::sqrt(3.0 * 50.0));
  // Beside a bare wall the prediction degrades from scan to scan, and the map follows it.
  MotionFilter filter;
  filter.begin({0.01 * 0.01, 0.01 * 0.01});
  Vector3 before = Vector3::Zero();
  for (int i = 0; i < 100; ++i) {
    filter.advance(kStep, 0.0);
    const Vector3 variance = filter.position_variance(Matrix3::Identity());
    CHECK((variance.array() > before.array()).all());
    before = variance;
    filter.correct(Matrix3::Identity(), Vector3::Zero(), Vector3::Zero());
  }
  CHECK(std::sqrt(before.maxCoeff()) < 0.05);
}

TEST_CASE("a known gravity-and-bias outweighs scans that pull the same way for seconds", "[motion_filter]") {
  // Everything in sight departs with the vehicle: scans show no motion, the IMU measures 1.2 m/s^2.
  MotionFilter filter;
  filter.begin({0.02 * 0.02, 0.02 * 0.02});
  double gravity_bias = 0.0;
  double velocity = 0.0;
  for (int i = 0; i < 20; ++i) {
    velocity += (1.2 - gravity_bias) * kStep;
    filter.advance(kStep, 0.0);
    // Residuals beyond the kernel of the registration have no weight.
    const Vector3 moved(-std::min(0.01, 0.03 * velocity * kStep), 0.0, 0.0);
    velocity += filter.velocity_gain(Matrix3::Identity()).x() * moved.x();
    gravity_bias += filter.correct(Matrix3::Identity(), moved, Vector3(0.05, 0.0, 0.0)).x();
    CHECK_FALSE(filter.is_contradicted());
  }
  CHECK(gravity_bias < 0.2);
  CHECK(velocity > 2.0);
}

TEST_CASE("a wrong gravity-and-bias with small variance is contradicted by fully observing scans",
          "[motion_filter]") {
  // As after a map reset with other axes: an error of 2 m/s^2 at a standard deviation of 0.02.
  MotionFilter filter;
  filter.begin({0.02 * 0.02, 0.02 * 0.02});
  Vector3 velocity = Vector3::Zero();
  Vector3 gravity_bias = Vector3(2.0, 0.0, 0.0);
  int scans = 0;
  for (; scans < 50 && !filter.is_contradicted(); ++scans) {
    velocity -= gravity_bias * kStep;
    filter.advance(kStep, 0.0);
    const Vector3 share = Vector3::Constant(0.5);
    const Vector3 moved = share.cwiseProduct(-velocity * kStep);
    velocity += filter.velocity_gain(Matrix3::Identity()).cwiseProduct(moved);
    gravity_bias += filter.correct(Matrix3::Identity(), moved, share);
  }
  CHECK(scans < 10);
}

TEST_CASE("the variance of gravity-and-bias grows in a turn", "[motion_filter]") {
  MotionFilter straight;
  MotionFilter turned;
  for (MotionFilter* filter : {&straight, &turned}) filter->begin({0.0, 0.0});
  straight.advance(5.0, 0.0);
  turned.advance(5.0, -1.5);
  CHECK(std::sqrt(straight.gravity_bias_variance()) < 0.05);
  CHECK(std::sqrt(turned.gravity_bias_variance()) > 0.1);
}

TEST_CASE("after a reset the filter starts without any correlation", "[motion_filter]") {
  MotionFilter filter;
  CHECK_FALSE(filter.has_begun());
  filter.begin({1.0, 1.0});
  CHECK(filter.has_begun());
  filter.advance(1.0, 0.0);
  CHECK(filter.velocity_gain(Matrix3::Identity()).minCoeff() > 0.5);
  filter.forget();
  CHECK_FALSE(filter.has_begun());
  filter.begin({0.0, 0.0});
  CHECK(filter.has_begun());
  CHECK(filter.velocity_gain(Matrix3::Identity()).norm() == 0.0);
  CHECK(filter.gravity_bias_variance() == 0.0);
}
