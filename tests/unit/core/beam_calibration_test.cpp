#include "core/src/preprocessing/beam_calibration.hpp"

#include "nilio/core/odometry.hpp"
#include "nilio/core/units.hpp"

#include "tests/support/synthetic_room.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;
using nilio::kRadiansPerDegree;
using nilio::tests::Room;
using nilio::tests::scan_room;

namespace {

constexpr std::size_t kBeams = 16;
constexpr double kPointVariance = 0.02 * 0.02;

/// Spherical coordinates of a point; azimuth counterclockwise.
Vector3 point_at(double range_m, double elevation_rad, double azimuth_rad) {
  return range_m * Vector3(std::cos(elevation_rad) * std::cos(azimuth_rad),
                           std::cos(elevation_rad) * std::sin(azimuth_rad), std::sin(elevation_rad));
}

double nominal_elevation(std::size_t beam) {
  return (-15.0 + 2.0 * static_cast<double>(beam)) * kRadiansPerDegree;
}

using Errors = std::array<BeamCorrection, kBeams>;

/// Drawn errors without a part that all beams share.
Errors draw_errors(std::mt19937_64& generator, double range_m, double angle_deg) {
  std::normal_distribution<double> normal;
  Errors errors;
  BeamCorrection mean;
  for (BeamCorrection& e : errors) {
    e = {range_m * normal(generator), angle_deg * kRadiansPerDegree * normal(generator),
         angle_deg * kRadiansPerDegree * normal(generator)};
    mean.range_m += e.range_m / kBeams;
    mean.elevation_rad += e.elevation_rad / kBeams;
    mean.azimuth_rad += e.azimuth_rad / kBeams;
  }
  for (BeamCorrection& e : errors) {
    e.range_m -= mean.range_m;
    e.elevation_rad -= mean.elevation_rad;
    e.azimuth_rad -= mean.azimuth_rad;
  }
  return errors;
}

/// Scans of planes in all directions, which are known exactly.
void observe_planes(BeamCalibration& calibration, const Errors& errors, double noise_m, int scans,
                    std::mt19937_64& generator) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  for (int scan = 0; scan < scans; ++scan) {
    for (std::size_t i = 0; i < kBeams; ++i) {
      for (int k = 0; k < 20; ++k) {
        const double range_m = 5.0 + 25.0 * uniform(generator);
        const double azimuth_rad = 2.0 * M_PI * uniform(generator);
        const double elevation_rad = nominal_elevation(i);
        const Vector3 seen = point_at(range_m, elevation_rad, azimuth_rad);
        const Vector3 surface = point_at(range_m + errors[i].range_m, elevation_rad + errors[i].elevation_rad,
                                         azimuth_rad + errors[i].azimuth_rad);
        const Vector3 n = Vector3(normal(generator), normal(generator), normal(generator)).normalized();
        const Vector3 p = calibration.correct(seen.cast<float>(), static_cast<float>(i)).cast<double>();
        calibration.add({static_cast<float>(i), p, n, n.dot(p - surface) + noise_m * normal(generator), 1.0});
      }
    }
    calibration.update(kPointVariance);
  }
}

/// Root mean squares of the errors that are left.
BeamCorrection deviation_from(const Errors& errors, const BeamCalibration& calibration) {
  BeamCorrection square;
  for (std::size_t i = 0; i < kBeams; ++i) {
    const BeamCorrection c = calibration.correction_of(i);
    square.range_m += std::pow(c.range_m - errors[i].range_m, 2) / kBeams;
    square.elevation_rad += std::pow(c.elevation_rad - errors[i].elevation_rad, 2) / kBeams;
    square.azimuth_rad += std::pow(c.azimuth_rad - errors[i].azimuth_rad, 2) / kBeams;
  }
  return {std::sqrt(square.range_m), std::sqrt(square.elevation_rad), std::sqrt(square.azimuth_rad)};
}

}  // namespace

TEST_CASE("errors of beams in range, elevation and azimuth follow from distances to planes",
          "[beam_calibration]") {
  std::mt19937_64 generator(11);
  for (int unit = 0; unit < 5; ++unit) {
    const Errors errors = draw_errors(generator, 0.025, 0.1);
    BeamCalibration calibration;
    observe_planes(calibration, errors, 0.02, 200, generator);
    const BeamCorrection left = deviation_from(errors, calibration);
    CAPTURE(unit);
    CHECK(left.range_m < 0.2 * 0.025);
    CHECK(left.elevation_rad < 0.2 * 0.1 * kRadiansPerDegree);
    CHECK(left.azimuth_rad < 0.2 * 0.1 * kRadiansPerDegree);
  }
}

TEST_CASE("beams without errors stay as they are beside noise", "[beam_calibration]") {
  std::mt19937_64 generator(12);
  BeamCalibration calibration;
  observe_planes(calibration, {}, 0.02, 500, generator);
  const BeamCorrection left = deviation_from({}, calibration);
  CHECK(left.range_m < 0.002);
  CHECK(left.elevation_rad < 0.02 * kRadiansPerDegree);
  CHECK(left.azimuth_rad < 0.02 * kRadiansPerDegree);
}

TEST_CASE("errors that all beams share are left to the mounting", "[beam_calibration]") {
  std::mt19937_64 generator(13);
  Errors errors;
  errors.fill({0.03, 0.2 * kRadiansPerDegree, 0.2 * kRadiansPerDegree});
  BeamCalibration calibration;
  observe_planes(calibration, errors, 0.0, 200, generator);
  for (std::size_t i = 0; i < kBeams; ++i) {
    CHECK(std::abs(calibration.correction_of(i).range_m) < 0.003);
    CHECK(std::abs(calibration.correction_of(i).elevation_rad) < 0.02 * kRadiansPerDegree);
    CHECK(std::abs(calibration.correction_of(i).azimuth_rad) < 0.02 * kRadiansPerDegree);
  }
}

TEST_CASE("points without a beam number or a direction are not corrected and show nothing",
          "[beam_calibration]") {
  std::mt19937_64 generator(15);
  const Errors errors = draw_errors(generator, 0.025, 0.1);
  BeamCalibration calibration;
  observe_planes(calibration, errors, 0.0, 50, generator);
  const Eigen::Vector3f point(10.0F, 2.0F, -1.0F);
  CHECK(calibration.correct(point, 256.0F) == point);
  CHECK(calibration.correct(point, -0.5F) == point);
  CHECK(calibration.correct(point, std::numeric_limits<float>::quiet_NaN()) == point);
  CHECK(calibration.correct(point, 3.0F) != point);
  const Eigen::Vector3f above(0.0F, 0.0F, 5.0F);
  CHECK(calibration.correct(above, 3.0F) == above);
  const BeamCorrection before = calibration.correction_of(3);
  calibration.add({300.0F, point.cast<double>(), Vector3::UnitX(), 0.1, 1.0});
  calibration.add({3.0F, above.cast<double>(), Vector3::UnitZ(), 0.1, 1.0});
  calibration.update(kPointVariance);
  CHECK(calibration.correction_of(3).range_m == Approx(before.range_m).margin(1e-4));
}

TEST_CASE("a drive finds the errors of the beams, and not when it may not", "[beam_calibration]") {
  constexpr int kScans = 80;
  nilio::tests::ScannerSettings scanner;
  scanner.lowest_deg = -15.0;
  scanner.spacing_deg = 1.5;
  std::mt19937_64 generator(16);
  const Errors errors = draw_errors(generator, 0.025, 0.05);
  const auto driving = [](double t) {
    return SE3{Eigen::Quaterniond(Eigen::AngleAxisd(0.15 * std::sin(0.8 * t), Vector3::UnitZ())),
               Vector3(8.0 * t, 1.5 * (1.0 - std::cos(0.8 * t)), 0.0)};
  };
  for (const bool may : {true, false}) {
    OdometryConfig config;
    config.calibrate_beams = may;
    Odometry odometry(config);
    for (int i = 0; i < kScans; ++i) {
      Scan scan = scan_room(Room::with_pillars(), driving, 0.1 * i, static_cast<std::uint64_t>(i), scanner);
      for (Point& point : scan.points) {
        const Vector3 p(point.x, point.y, point.z);
        const BeamCorrection& e = errors[point.ring];
        const Vector3 seen = point_at(p.norm() - e.range_m, std::asin(p.z() / p.norm()) - e.elevation_rad,
                                      std::atan2(p.y(), p.x()) - e.azimuth_rad);
        point.x = static_cast<float>(seen.x());
        point.y = static_cast<float>(seen.y());
        point.z = static_cast<float>(seen.z());
      }
      odometry.register_scan(scan);
    }
    double range_square = 0.0;
    double range_left = 0.0;
    double azimuth_square = 0.0;
    double azimuth_left = 0.0;
    for (std::size_t i = 0; i < kBeams; ++i) {
      const BeamCorrection found = odometry.beam_correction(i);
      if (!may) CHECK((found.range_m == 0.0 && found.elevation_rad == 0.0 && found.azimuth_rad == 0.0));
      range_square += std::pow(errors[i].range_m, 2);
      range_left += std::pow(errors[i].range_m - found.range_m, 2);
      azimuth_square += std::pow(errors[i].azimuth_rad, 2);
      azimuth_left += std::pow(errors[i].azimuth_rad - found.azimuth_rad, 2);
    }
    if (!may) continue;
    // On a floor an error of elevation is one of range: nothing tells them apart.
    CHECK(range_left < 0.85 * range_square);
    CHECK(azimuth_left < 0.85 * azimuth_square);
  }
}
