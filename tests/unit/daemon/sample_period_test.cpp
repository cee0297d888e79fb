#include "daemon/odometry/sample_period.hpp"

#include <catch2/catch.hpp>

using nilio::core::Duration;
using nilio::daemon::SamplePeriodEstimator;

TEST_CASE("the next sample is due one period after the last one; two samples are needed", "[sample_period]") {
  SamplePeriodEstimator estimator;
  CHECK_FALSE(estimator.due_after({100}, {0}));
  estimator.add({0});
  CHECK_FALSE(estimator.due_after({100}, {0}));
  estimator.add({10'000'000});
  CHECK(estimator.due_after({13'000'000}, {10'000'000}) == Duration{7'000'000});
  CHECK(estimator.due_after({20'000'000}, {10'000'000}) == Duration{});
  CHECK(estimator.due_after({5'000'000}, {10'000'000}) == Duration{});
  // Some samples that were already sent have not arrived yet.
  CHECK(estimator.due_after({41'000'000}, {10'000'000}) == Duration{9'000'000});
}

TEST_CASE("gaps, repeated stamps and a clock set back do not change the period", "[sample_period]") {
  SamplePeriodEstimator estimator;
  std::int64_t stamp = 0;
  for (int i = 0; i < 50; ++i) estimator.add({stamp += 2'500'000});
  estimator.add({stamp});
  estimator.add({stamp += 5'000'000'000});
  estimator.add({stamp -= 3'000'000'000});
  CHECK(estimator.due_after({stamp + 1}, {stamp}) == Duration{2'499'999});
  // A new estimator is taken up.
  for (int i = 0; i < 200; ++i) estimator.add({stamp += 5'000'000});
  CHECK(estimator.due_after({stamp + 1}, {stamp})->ns == Approx(5e6).epsilon(0.01));
}
