#include "tools/common/statistics.hpp"

#include "tools/bench/soak/soak.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio::tools;
using namespace nilio::tools::bench;

namespace {

std::vector<double> seconds(std::size_t count) {
  std::vector<double> x(count);
  for (std::size_t i = 0; i < count; ++i) x[i] = static_cast<double>(i);
  return x;
}

/// Numbers in [-1, 1) that repeat in every run (xorshift64*).
class Noise {
 public:
  double next() {
    state_ ^= state_ >> 12U;
    state_ ^= state_ << 25U;
    state_ ^= state_ >> 27U;
    return static_cast<double>((state_ * 2685821657736338717ULL) >> 11U) * 0x1p-52 - 1.0;
  }

 private:
  std::uint64_t state_ = 88172645463325252ULL;
};

MemorySeries series_of(const std::vector<double>& kib) {
  MemorySeries series;
  series.name = "test";
  for (std::size_t i = 0; i < kib.size(); ++i) series.minutes.push_back(static_cast<double>(i) / 60.0);
  series.kib = kib;
  series.fit = fit_line(series.minutes, series.kib);
  return series;
}

}  // namespace

TEST_CASE("samples on a line give its slope with error zero", "[statistics]") {
  const std::vector<double> x = seconds(50);
  std::vector<double> y;
  for (const double t : x) y.push_back(7.0 + 0.25 * t);
  const LineFit fit = fit_line(x, y);
  CHECK(fit.samples == 50);
  CHECK(fit.slope == Approx(0.25));
  CHECK(fit.standard_error == Approx(0.0).margin(1e-9));
  CHECK(fit.rise == Approx(12.25));
  CHECK_FALSE(fit.is_level());
}

TEST_CASE("slope and standard error are those of the textbook for independent samples", "[statistics]") {
  // Residuals +1 -1 -1 +1 ...: without slope, and their lag-1 products cancel.
  const std::vector<double> x = seconds(8);
  const std::vector<double> y{1, -1, -1, 1, 1, -1, -1, 1};
  const LineFit fit = fit_line(x, y);
  CHECK(fit.slope == Approx(0.0).margin(1e-12));
  const double square_sum = 8.0;
  CHECK(fit.standard_error == Approx(std::sqrt(square_sum / 6.0 / 42.0)));
  CHECK(fit.is_level());
}

TEST_CASE("twice the standard error covers a true slope in about 95 % of cases", "[statistics]") {
  Noise noise;
  int covered = 0;
  const int trials = 1000;
  const std::vector<double> x = seconds(100);
  for (int trial = 0; trial < trials; ++trial) {
    std::vector<double> y;
    for (const double t : x) y.push_back(0.03 * t + noise.next());
    const LineFit fit = fit_line(x, y);
    covered += std::abs(fit.slope - 0.03) <= 2.0 * fit.standard_error ? 1 : 0;
  }
  CHECK(covered > 930);
  CHECK(covered < 990);
}

TEST_CASE("a random walk is no trend, although it would be one for independent samples", "[statistics]") {
  Noise noise;
  int trends = 0;
  const std::vector<double> x = seconds(300);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<double> y;
    double at = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i) y.push_back(at += noise.next());
    trends += fit_line(x, y).is_level() ? 0 : 1;
  }
  // For independent samples it would be above 90 %.
  CHECK(trends < 40);
}

TEST_CASE("a single step of any height is no trend; ten steps are one", "[statistics]") {
  const std::vector<double> x = seconds(600);
  std::vector<double> once(600, 0.0);
  std::fill(once.begin() + 250, once.end(), 1000.0);
  CHECK(fit_line(x, once).is_level());
  CHECK(fit_line(x, once).slope > 0.0);
  std::vector<double> often;
  for (const double t : x) often.push_back(std::floor(t / 55.0));
  CHECK_FALSE(fit_line(x, often).is_level());
}

TEST_CASE("too few samples, or all at one x, give no line", "[statistics]") {
  CHECK(fit_line(seconds(2), seconds(2)).slope == 0.0);
  const std::vector<double> same(5, 1.0);
  CHECK(fit_line(same, seconds(5)).slope == 0.0);
  CHECK_FALSE(is_level(series_of({1.0, 1.0, 1.0})));
}

TEST_CASE(
    "memory that is constant, or takes one page, is level; a leak of two KiB a minute or a larger step is "
    "not",
    "[statistics]") {
  std::vector<double> kib(600, 40000.0);
  CHECK(is_level(series_of(kib)));
  for (std::size_t i = 300; i < kib.size(); ++i) kib[i] += 4.0;
  CHECK(is_level(series_of(kib)));
  for (std::size_t i = 0; i < kib.size(); ++i)
    kib[i] = 40000.0 + 4.0 * std::floor(static_cast<double>(i) / 120.0);
  CHECK_FALSE(is_level(series_of(kib)));
  // One step of 16 pages: no trend, and too much for half an hour.
  kib.assign(1800, 40000.0);
  std::fill(kib.begin() + 900, kib.end(), 40064.0);
  CHECK_FALSE(is_level(series_of(kib)));
  CHECK(is_level(series_of({kib.begin() + 600, kib.begin() + 1200})));
}

TEST_CASE("the faults of a soak run are listed, and a good run has none", "[statistics]") {
  SoakResult result;
  result.pipeline = series_of(std::vector<double>(100, 5.0));
  result.scans = result.poses = 900;
  result.recorded = {{"filter", 900}, {"fine", 900}};
  CHECK(find_faults(result).empty());
  result.recorded[1].second = 899;
  CHECK(find_faults(result).empty());
  result.recorded[1].second = 898;
  REQUIRE(find_faults(result).size() == 1);
  CHECK(find_faults(result).front() == "the histogram of fine has 898 of 900 poses");
  result.poses = 899;
  result.packets_dropped = 3;
  result.publisher_restarts = 1;
  CHECK(find_faults(result).size() == 4);
  std::vector<double> leaking;
  for (int i = 0; i < 100; ++i) leaking.push_back(3.0 * i);
  result.pipeline = series_of(leaking);
  REQUIRE(find_faults(result).size() == 5);
  CHECK(find_faults(result).front().find("memory changes by 180.000") != std::string::npos);
}

TEST_CASE("percentiles are values of the set", "[statistics]") {
  CHECK(percentiles_of({}).maximum == 0.0);
  CHECK(percentiles_of({3.0}).p99 == 3.0);
  std::vector<double> values;
  for (int i = 200; i > 0; --i) values.push_back(i);
  const Percentiles percentiles = percentiles_of(values);
  CHECK(percentiles.median == 100.0);
  CHECK(percentiles.p99 == 198.0);
  CHECK(percentiles.maximum == 200.0);
}
