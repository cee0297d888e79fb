#include "core/src/estimation/innovation_bias.hpp"

#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;

namespace {

/// Innovations of a deviation along each axis, as a filter with a correct covariance weights them.
struct Innovations {
  Vector6 deviation = (Vector6() << 0.05, 0.02, 0.01, 1e-3, 2e-3, 1e-3).finished();
  std::mt19937 random{7};
  std::normal_distribution<double> normal;

  WeightedInnovation next(const Vector6& bias_sigmas) {
    const Vector6 weight = deviation.cwiseAbs2().cwiseInverse();
    Vector6 innovation;
    for (int i = 0; i < 6; ++i) innovation[i] = deviation[i] * (bias_sigmas[i] + normal(random));
    return {weight.cwiseProduct(innovation), weight.asDiagonal()};
  }
};

int scans_until_significant(const Vector6& bias_sigmas, int most) {
  Innovations innovations;
  InnovationBias bias;
  for (int i = 1; i <= most; ++i) {
    bias.add(innovations.next(bias_sigmas));
    if (bias.is_significant()) return i;
  }
  return 0;
}

}  // namespace

TEST_CASE("white innovations of any size have no bias", "[innovation_bias]") {
  CHECK(scans_until_significant(Vector6::Zero(), 100'000) == 0);
}

TEST_CASE("innovations that push a vehicle aside or up for a second are a bias", "[innovation_bias]") {
  CHECK(scans_until_significant(2.0 * Vector6::Unit(1), 100) > 3);
  CHECK(scans_until_significant(2.0 * Vector6::Unit(1), 100) < 20);
  CHECK(scans_until_significant(-2.0 * Vector6::Unit(2), 100) < 20);
}

TEST_CASE("along the way other vehicles push, and turns tell about a gyro", "[innovation_bias]") {
  for (const int axis : {0, 3, 4, 5}) CHECK(scans_until_significant(3.0 * Vector6::Unit(axis), 1000) == 0);
}

TEST_CASE("a scan that does not see a direction says nothing about it", "[innovation_bias]") {
  InnovationBias bias;
  for (int i = 0; i < 100; ++i) bias.add({});
  CHECK_FALSE(bias.is_significant());
}
