#include "nilio/core/portable_math.hpp"

#include <cmath>
#include <limits>
#include <random>

#include <catch2/catch.hpp>

namespace portable = nilio::portable;

namespace {

constexpr double kUnit = std::numeric_limits<double>::epsilon();

/// Within four units in the last place.
bool agree(double value, double reference) {
  return std::abs(value - reference) <= 4.0 * kUnit * std::abs(reference);
}

}  // namespace

TEST_CASE("portable functions agree with the C library's to four units in the last place",
          "[portable_math]") {
  std::mt19937_64 generator(3);
  std::uniform_real_distribution<double> angle(-3.2, 3.2);
  std::uniform_real_distribution<double> cosine(-1.0, 1.0);
  std::uniform_real_distribution<double> exponent(-40.0, 2.0);
  for (int i = 0; i < 20'000; ++i) {
    const double a = angle(generator);
    const double c = cosine(generator);
    const double x = exponent(generator);
    CAPTURE(a, c, x);
    REQUIRE(agree(portable::sin(a), std::sin(a)));
    REQUIRE(agree(portable::cos(a), std::cos(a)));
    REQUIRE(agree(portable::tan(a), std::tan(a)));
    REQUIRE(agree(portable::acos(c), std::acos(c)));
    REQUIRE(agree(portable::atan2(a, c), std::atan2(a, c)));
    REQUIRE(agree(portable::exp(x), std::exp(x)));
    REQUIRE(agree(portable::log(std::exp(x)), std::log(std::exp(x))));
  }
}

TEST_CASE("portable functions are exact at their special values", "[portable_math]") {
  CHECK(portable::sin(0.0) == 0.0);
  CHECK(portable::cos(0.0) == 1.0);
  CHECK(portable::acos(1.0) == 0.0);
  CHECK(portable::atan2(0.0, 1.0) == 0.0);
  CHECK(portable::atan2(0.0, -1.0) == M_PI);
  CHECK(portable::exp(0.0) == 1.0);
  CHECK(portable::exp(-1000.0) == 0.0);
  CHECK(portable::log(1.0) == 0.0);
  CHECK(std::isnan(portable::sin(std::numeric_limits<double>::quiet_NaN())));
}
