#include "core/src/estimation/pose_slew_limiter.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;

namespace {

constexpr Duration kSample{2'500'000};

PoseSlewLimits limits() {
  PoseSlewLimits limits;
  limits.max_slew_m_s = 0.5;
  limits.max_slew_rad_s = 0.1;
  limits.jump_m = 1.0;
  limits.jump_rad = 0.2;
  return limits;
}

SE3 moved(const SE3& pose, const Vector3& by, const Vector3& turn) {
  return {(so3_exp(turn) * pose.rotation).normalized(), pose.translation + by};
}

}  // namespace

TEST_CASE("without corrections the limited pose is the propagated one", "[pose_slew_limiter]") {
  PoseSlewLimiter smoother(limits());
  const SE3 pose{so3_exp(Vector3(0.1, 0.2, 0.3)), Vector3(1.0, 2.0, 3.0)};
  CHECK(smoother.smooth(pose, kSample).translation == pose.translation);
  CHECK(smoother.smooth(pose, kSample).rotation.angularDistance(pose.rotation) < 1e-12);
  CHECK(smoother.jumps() == 0);
}

TEST_CASE("the published motion never differs from the propagated one by more than the slew limits",
          "[pose_slew_limiter]") {
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0.0, 1.0);
  const auto vector = [&](double size) {
    return Vector3(size * noise(random), size * noise(random), size * noise(random));
  };
  PoseSlewLimiter smoother(limits());
  SE3 propagated;
  SE3 published = smoother.smooth(propagated, kSample);
  double largest_m = 0.0;
  double largest_rad = 0.0;
  std::uint64_t corrections = 0;
  for (int i = 0; i < 40'000; ++i) {
    const SE3 before = propagated;
    propagated = propagated * SE3{so3_exp(vector(0.01)), Vector3(0.03, 0.0, 0.0) + vector(0.005)};
    const Vector3 travelled = propagated.translation - before.translation;
    const double turned = before.rotation.angularDistance(propagated.rotation);
    if (i % 40 == 17) {
      const SE3 corrected = moved(propagated, vector(0.1), vector(0.02));
      REQUIRE_FALSE(smoother.correct(propagated, corrected).jumped);
      ++corrections;
      propagated = corrected;
    }
    const SE3 next = smoother.smooth(propagated, kSample);
    largest_m = std::max(largest_m, (next.translation - published.translation - travelled).norm());
    largest_rad = std::max(largest_rad, std::abs(published.rotation.angularDistance(next.rotation) - turned));
    published = next;
  }
  CHECK(corrections == 1000);
  CHECK(largest_m <= 0.5 * kSample.seconds() + 1e-9);
  CHECK(largest_rad <= 0.1 * kSample.seconds() + 1e-9);
  CHECK(largest_m > 0.45 * kSample.seconds());  // the bound is used
  CHECK(smoother.jumps() == 0);
}

TEST_CASE("a correction decays at the limit while large, then with the time constant",
          "[pose_slew_limiter]") {
  PoseSlewLimiter smoother(limits());
  const SE3 before{Eigen::Quaterniond::Identity(), Vector3(0.4, 0.0, 0.0)};
  const PoseCorrection correction = smoother.correct(before, SE3{});
  CHECK(correction.distance_m == Approx(0.4));
  CHECK_FALSE(correction.jumped);
  // 0.4 m at 0.5 m/s down to 0.05 m, where 0.05 m / 0.1 s is slower: 0.7 s.
  CHECK(smoother.smooth(SE3{}, Duration{0}).translation.x() == Approx(0.4));
  for (int i = 0; i < 280; ++i) smoother.smooth(SE3{}, kSample);
  CHECK(smoother.translation_left().x() == Approx(0.05).epsilon(0.01));
  for (int i = 0; i < 40; ++i) smoother.smooth(SE3{}, kSample);
  CHECK(smoother.translation_left().x() == Approx(0.05 * std::exp(-1.0)).epsilon(0.02));
}

TEST_CASE("a correction beyond the threshold is applied at once, counted and reported",
          "[pose_slew_limiter]") {
  PoseSlewLimiter smoother(limits());
  SECTION("of the position") {
    const PoseCorrection correction =
        smoother.correct(SE3{Eigen::Quaterniond::Identity(), Vector3(0.0, 1.01, 0.0)}, SE3{});
    CHECK(correction.jumped);
    CHECK(correction.distance_m == Approx(1.01));
  }
  SECTION("of the orientation") {
    const PoseCorrection correction =
        smoother.correct(SE3{so3_exp(Vector3(0.0, 0.0, 0.21)), Vector3::Zero()}, SE3{});
    CHECK(correction.jumped);
    CHECK(correction.angle_rad == Approx(0.21));
  }
  SECTION("of small ones that pile up") {
    for (int i = 0; i < 3; ++i) {
      CHECK(smoother.jumps() == 0);
      smoother.correct(SE3{Eigen::Quaterniond::Identity(), Vector3(0.4, 0.0, 0.0)}, SE3{});
    }
  }
  SECTION("of NaN") {
    CHECK(
        smoother.correct(SE3{Eigen::Quaterniond::Identity(), Vector3::Constant(std::nan(""))}, SE3{}).jumped);
  }
  CHECK(smoother.jumps() == 1);
  CHECK(smoother.smooth(SE3{}, Duration{0}).translation == Vector3::Zero());
}
