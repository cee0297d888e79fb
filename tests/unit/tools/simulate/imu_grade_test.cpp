#include "tools/simulate/sensors/imu_grade.hpp"

#include "nilio/core/units.hpp"

#include <array>
#include <cmath>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools::simulate;
using core::SE3;

namespace {

VehicleTrajectory parked(double seconds) {
  return {std::vector<SE3>(static_cast<std::size_t>(seconds / kControlIntervalS) + 1), kControlIntervalS};
}

std::vector<core::ImuSample> samples(ImuGrade grade, const VehicleTrajectory& trajectory,
                                     std::uint64_t seed) {
  ImuModelConfig config;
  config.seed = seed;
  config.rate_hz = 100.0;
  GradedImu imu(grade, config, trajectory);
  std::vector<core::ImuSample> result;
  for (std::uint64_t i = 0; i < imu.sample_count(); ++i) result.push_back(imu.next());
  return result;
}

/// Standard deviation of successive differences over sqrt(2): the white noise of a sample.
double white_noise(const std::vector<core::ImuSample>& samples) {
  double squares = 0.0;
  for (std::size_t i = 1; i < samples.size(); ++i)
    squares += std::pow(samples[i].angular_velocity[0] - samples[i - 1].angular_velocity[0], 2);
  return std::sqrt(0.5 * squares / static_cast<double>(samples.size() - 1));
}

}  // namespace

TEST_CASE("the white noise of a sample is the density times the root of half the rate", "[imu_grade]") {
  const VehicleTrajectory trajectory = parked(60.0);
  for (const auto& [grade, density] : {std::pair(ImuGrade::kConsumer, 0.010),
                                       {ImuGrade::kIndustrial, 0.007},
                                       {ImuGrade::kTactical, 0.002}}) {
    const double expected = density * kRadiansPerDegree * std::sqrt(50.0);
    CHECK(white_noise(samples(grade, trajectory, 1)) == Approx(expected).epsilon(0.05));
  }
}

TEST_CASE("biases at the start are drawn for each unit, by grade", "[imu_grade]") {
  const VehicleTrajectory trajectory = parked(2.0);
  const auto spread = [&](ImuGrade grade) {
    double squares = 0.0;
    for (std::uint64_t seed = 1; seed <= 30; ++seed) {
      const auto read = samples(grade, trajectory, seed);
      std::array<double, 3> mean{};
      for (const core::ImuSample& sample : read)
        for (std::size_t a = 0; a < 3; ++a)
          mean[a] += sample.angular_velocity[a] / static_cast<double>(read.size());
      for (const double value : mean) squares += value * value;
    }
    return std::sqrt(squares / 90.0) * kDegreesPerRadian;
  };
  // With the sensitivity to gravity.
  CHECK(spread(ImuGrade::kConsumer) == Approx(std::hypot(0.5, 0.1)).epsilon(0.25));
  CHECK(spread(ImuGrade::kTactical) == Approx(std::hypot(0.005, 0.002)).epsilon(0.25));
}

TEST_CASE("an automotive sensor sends whole steps and clips", "[imu_grade]") {
  for (const core::ImuSample& sample : samples(ImuGrade::kAutomotive, parked(2.0), 4)) {
    const double steps = sample.angular_velocity[1] * kDegreesPerRadian / 0.1;
    CHECK(std::abs(steps - std::round(steps)) < 1e-6);
    CHECK(std::abs(sample.linear_acceleration[2]) <= 4.2 * 9.80665 + 1e-9);
  }
}

TEST_CASE("stamps are late by the delay and the samples by the filter", "[imu_grade]") {
  const auto read = samples(ImuGrade::kConsumer, parked(1.0), 1);
  CHECK(read.front().stamp.ns == 10'000'000);
  CHECK((read[1].stamp - read[0].stamp).ns == 10'000'000);
  CHECK(read[50].linear_acceleration[2] == Approx(9.81).margin(1.5));
}
