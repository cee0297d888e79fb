#include "tools/bench/matrix/statistics.hpp"

#include <cmath>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio::tools::bench;

namespace {

void check_interval(const Interval& interval, double low_percent, double high_percent) {
  CHECK(100.0 * interval.low == Approx(low_percent).margin(0.5));
  CHECK(100.0 * interval.high == Approx(high_percent).margin(0.5));
}

}  // namespace

TEST_CASE("the interval of a success count is Wilson's", "[statistics]") {
  // Published values of the method, in per cent.
  check_interval(wilson_interval(6, 6), 61, 100);
  check_interval(wilson_interval(12, 12), 76, 100);
  check_interval(wilson_interval(17, 20), 64, 95);
  check_interval(wilson_interval(45, 50), 79, 96);
  check_interval(wilson_interval(59, 60), 91, 100);
  check_interval(wilson_interval(0, 6), 0, 39);
  check_interval(wilson_interval(0, 0), 0, 100);
}

TEST_CASE("the geometric mean of a ratio and its inverse is one", "[statistics]") {
  CHECK(geometric_mean(std::vector<double>{4.0, 0.25}) == Approx(1.0));
  CHECK(geometric_mean(std::vector<double>{1.0, 10.0, 100.0}) == Approx(10.0));
  CHECK(std::isnan(geometric_mean({})));
}

TEST_CASE("a mean ratio weighs rows equally and repeats to the bit", "[statistics]") {
  // Nine pairs at 1 and one pair at 4 in another row: the rows count, not the pairs.
  const std::vector<std::vector<double>> rows{{1, 1, 1, 1, 1, 1, 1, 1, 1}, {4}, {}};
  const MeanRatio first = mean_ratio(rows);
  CHECK(first.ratio == Approx(2.0));
  CHECK(first.values == 10);
  // Equal values within each row: the interval is a point.
  CHECK(first.interval.low == Approx(2.0));
  CHECK(first.interval.high == Approx(2.0));

  const std::vector<std::vector<double>> spread{{0.5, 1.0, 2.0, 1.5, 0.8, 1.1}, {0.9, 1.3, 0.7, 1.0}};
  const MeanRatio a = mean_ratio(spread);
  const MeanRatio b = mean_ratio(spread);
  CHECK(a.interval.low == b.interval.low);
  CHECK(a.interval.high == b.interval.high);
  CHECK(a.interval.low < a.ratio);
  CHECK(a.ratio < a.interval.high);
  CHECK(std::isnan(mean_ratio({}).ratio));
}

TEST_CASE("the bootstrap interval of many equal draws is the normal one", "[statistics]") {
  // Logarithms +-0.4 in equal numbers: standard error 0.4 / sqrt(100).
  std::vector<double> ratios;
  for (int i = 0; i < 100; ++i) ratios.push_back(std::exp(i % 2 == 0 ? 0.4 : -0.4));
  const MeanRatio mean = mean_ratio(std::vector<std::vector<double>>{ratios});
  CHECK(mean.ratio == Approx(1.0));
  CHECK(std::log(mean.interval.low) == Approx(-1.96 * 0.04).margin(0.005));
  CHECK(std::log(mean.interval.high) == Approx(1.96 * 0.04).margin(0.005));
}

TEST_CASE("the exact test of failures gives the probabilities of a fair coin", "[statistics]") {
  CHECK(mcnemar_p(0, 6) == Approx(2.0 / 64.0));
  CHECK(mcnemar_p(1, 6) == Approx(2.0 * 8.0 / 128.0));
  CHECK(mcnemar_p(6, 1) == Approx(mcnemar_p(1, 6)));
  CHECK(mcnemar_p(3, 3) == Approx(1.0));
  CHECK(mcnemar_p(0, 0) == Approx(1.0));
}
