#include "core/src/estimation/felt_motion_filter.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;

namespace {

constexpr double kStep = 0.1;
constexpr double kScanDeviation = 0.01;
constexpr double kForceDeviation = 0.1;

/// A vehicle whose velocity and support are wrong by as much as the filter is told, corrected by scans of
/// that noise.
struct Error {
  Vector3 place = Vector3::Zero();
  Vector3 velocity = Vector3::Zero();
  Vector3 support = Vector3::Zero();
};

struct Trial {
  Error error;
  double support_variance = 0.0;
};

Trial corrected_by_scans(const FeltMotionFilter::Variances& variances, int scans, bool shown, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const auto noise = [&] { return Vector3(normal(random), normal(random), normal(random)); };
  const Matrix3 R = so3_exp(Vector3(0.1, -0.2, 0.7)).toRotationMatrix();
  FeltMotionFilter filter;
  filter.begin(variances);
  Trial trial;
  Error& error = trial.error;  // estimate less truth
  error.velocity = std::sqrt(variances.velocity) * noise();
  error.support = std::sqrt(variances.support) * noise();
  for (int i = 0; i < scans; ++i) {
    const Vector3 wrong = error.support + kForceDeviation * noise();
    error.place += kStep * error.velocity - 0.5 * kStep * kStep * wrong;
    error.velocity -= kStep * wrong;
    filter.advance(kStep, 0.0);
    const Vector3 prior = filter.place_variance(R);
    Vector3 share = Vector3::Zero();
    if (shown) share = prior.array() / (prior.array() + kScanDeviation * kScanDeviation);
    const Vector3 seen = -(R.transpose() * error.place) + kScanDeviation * noise();
    const Vector3 moved = share.cwiseProduct(seen);
    const Vector3 gain = filter.velocity_gain(R);
    error.place += R * moved;
    error.velocity += R * gain.cwiseProduct(moved);
    error.support += filter.correct(R, moved, share);
  }
  trial.support_variance = filter.support_variance();
  return trial;
}

}  // namespace

TEST_CASE("scans tell what the accelerometer is biased by, as exactly as the filter says") {
  constexpr int kTrials = 200;
  double squares = 0.0;
  double variances = 0.0;
  for (unsigned seed = 1; seed <= kTrials; ++seed) {
    const Trial trial = corrected_by_scans({0.3 * 0.3, 0.5 * 0.5}, 50, true, seed);
    CHECK(trial.error.support.norm() < 0.4);
    CHECK(trial.error.velocity.norm() < 0.2);
    squares += trial.error.support.squaredNorm() / 3.0;
    variances += trial.support_variance;
  }
  CHECK(squares < 1.5 * variances);
  CHECK(squares > 0.5 * variances);
}

TEST_CASE("scans that show nothing leave velocity and support as they are felt") {
  const Trial trial = corrected_by_scans({0.0, 0.0}, 50, false, 1);
  CHECK(trial.error.support.norm() == 0.0);
  // Fifty steps, each wrong by that.
  CHECK(trial.error.velocity.norm() < 3.0 * kForceDeviation * kStep * std::sqrt(3.0 * 50.0));
  // Beside a bare wall the prediction is worth less from scan to scan, but the map moves on with it.
  FeltMotionFilter filter;
  filter.begin({0.01 * 0.01, 0.01 * 0.01});
  Vector3 before = Vector3::Zero();
  for (int i = 0; i < 100; ++i) {
    filter.advance(kStep, 0.0);
    const Vector3 variance = filter.place_variance(Matrix3::Identity());
    CHECK((variance.array() > before.array()).all());
    before = variance;
    filter.correct(Matrix3::Identity(), Vector3::Zero(), Vector3::Zero());
  }
  CHECK(std::sqrt(before.maxCoeff()) < 0.05);
}

TEST_CASE("a support that is known outweighs scans that pull the same way for seconds") {
  // Everything in sight sets off with the vehicle: scans say that it stands, 1.2 m/s^2 say that it does not.
  FeltMotionFilter filter;
  filter.begin({0.02 * 0.02, 0.02 * 0.02});
  double support = 0.0;
  double velocity = 0.0;
  for (int i = 0; i < 20; ++i) {
    velocity += (1.2 - support) * kStep;
    filter.advance(kStep, 0.0);
    // What is farther off than the kernel of the registration has no say.
    const Vector3 moved(-std::min(0.01, 0.03 * velocity * kStep), 0.0, 0.0);
    velocity += filter.velocity_gain(Matrix3::Identity()).x() * moved.x();
    support += filter.correct(Matrix3::Identity(), moved, Vector3(0.05, 0.0, 0.0)).x();
    CHECK_FALSE(filter.is_contradicted());
  }
  CHECK(support < 0.2);
  CHECK(velocity > 2.0);
}

TEST_CASE("a support that was taken to be known and is wrong is found out by scans that show everything") {
  // As after a map was given up with its axes: 2 m/s^2 where 0.02 were promised.
  FeltMotionFilter filter;
  filter.begin({0.02 * 0.02, 0.02 * 0.02});
  Vector3 velocity = Vector3::Zero();
  Vector3 support = Vector3(2.0, 0.0, 0.0);
  int scans = 0;
  for (; scans < 50 && !filter.is_contradicted(); ++scans) {
    velocity -= support * kStep;
    filter.advance(kStep, 0.0);
    const Vector3 share = Vector3::Constant(0.5);
    const Vector3 moved = share.cwiseProduct(-velocity * kStep);
    velocity += filter.velocity_gain(Matrix3::Identity()).cwiseProduct(moved);
    support += filter.correct(Matrix3::Identity(), moved, share);
  }
  CHECK(scans < 10);
}

TEST_CASE("a support is less certain after a turn, with which biases turn") {
  FeltMotionFilter straight;
  FeltMotionFilter turned;
  for (FeltMotionFilter* filter : {&straight, &turned}) filter->begin({0.0, 0.0});
  straight.advance(5.0, 0.0);
  turned.advance(5.0, -1.5);
  CHECK(std::sqrt(straight.support_variance()) < 0.05);
  CHECK(std::sqrt(turned.support_variance()) > 0.1);
}

TEST_CASE("what was forgotten has to begin anew, and then knows nothing of before") {
  FeltMotionFilter filter;
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
  CHECK(filter.support_variance() == 0.0);
}
