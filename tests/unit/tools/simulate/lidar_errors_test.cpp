#include "tools/simulate/sensors/lidar_errors.hpp"

#include "nilio/core/units.hpp"

#include "tools/simulate/random.hpp"

#include <cmath>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools::simulate;

namespace {

double standard_deviation(const std::vector<double>& values) {
  double sum = 0.0;
  double squares = 0.0;
  for (const double v : values) sum += v, squares += v * v;
  const auto n = static_cast<double>(values.size());
  return std::sqrt(squares / n - sum * sum / (n * n));
}

/// Departures of many drawn units from the nominal table: range, elevation and azimuth of each laser.
std::array<std::vector<double>, 3> departures(drivers::VelodyneModel model, Realism realism) {
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(model);
  std::array<std::vector<double>, 3> found;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    const LidarErrors errors(sensor, realism, Effects::all(), seed);
    for (std::size_t i = 0; i < sensor.lasers.size(); ++i) {
      found[0].push_back(errors.range_error_m(i, core::Duration{0}));
      found[1].push_back((errors.lasers()[i].elevation_rad - sensor.lasers[i].elevation_rad) *
                         kDegreesPerRadian);
      found[2].push_back(
          (errors.lasers()[i].azimuth_correction_rad - sensor.lasers[i].azimuth_correction_rad) *
          kDegreesPerRadian);
    }
  }
  return found;
}

}  // namespace

TEST_CASE("units of a model depart from the nominal table by the measured standard deviations",
          "[lidar_errors]") {
  // A cut at 2.5 standard deviations makes them 4 % smaller.
  const auto hdl64e = departures(drivers::VelodyneModel::kHdl64eS2, Realism::kTypical);
  CHECK(standard_deviation(hdl64e[0]) == Approx(0.025).epsilon(0.08));
  CHECK(standard_deviation(hdl64e[1]) == Approx(std::hypot(0.10, 0.10)).epsilon(0.15));
  CHECK(standard_deviation(hdl64e[2]) == Approx(0.10).epsilon(0.08));
  const auto vlp16 = departures(drivers::VelodyneModel::kVlp16, Realism::kTypical);
  CHECK(standard_deviation(vlp16[0]) == Approx(0.0130).epsilon(0.10));
  CHECK(standard_deviation(vlp16[2]) == Approx(0.05).epsilon(0.10));
  const auto poor = departures(drivers::VelodyneModel::kHdl64eS2, Realism::kPoor);
  CHECK(standard_deviation(poor[0]) == Approx(0.05).epsilon(0.08));
}

TEST_CASE("without the calibration effect a unit is its nominal table", "[lidar_errors]") {
  const auto sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  Effects noise;
  noise.add(Effect::kNoise);
  const LidarErrors errors(sensor, Realism::kTypical, noise, 3);
  CHECK(errors.lasers() == sensor.lasers);
  CHECK(errors.range_error_m(5, core::Duration::from_seconds(100.0)) == 0.0);
}

TEST_CASE("range errors drift by millimetres in minutes, not within a scan", "[lidar_errors]") {
  const auto sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kHdl64eS2);
  const LidarErrors errors(sensor, Realism::kTypical, Effects::all(), 1);
  double in_scan = 0.0;
  double in_hour = 0.0;
  for (std::size_t i = 0; i < sensor.lasers.size(); ++i) {
    const auto at = [&](double s) { return errors.range_error_m(i, core::Duration::from_seconds(s)); };
    in_scan = std::max(in_scan, std::abs(at(100.1) - at(100.0)));
    in_hour = std::max(in_hour, std::abs(at(1900.0) - at(100.0)));
  }
  CHECK(in_scan < 1e-5);
  CHECK(in_hour > 0.004);
}

TEST_CASE("white noise follows range and reflectivity as measured", "[lidar_errors]") {
  const auto make = [](drivers::VelodyneModel model) {
    return LidarErrors(drivers::make_velodyne_sensor(model), Realism::kTypical, Effects::all(), 1);
  };
  const LidarErrors hdl64e = make(drivers::VelodyneModel::kHdl64eS2);
  CHECK(hdl64e.noise_m(10.0, 0.2) == Approx(0.0084).epsilon(0.05));
  CHECK(hdl64e.noise_m(40.0, 0.2) == Approx(0.0133).epsilon(0.05));
  // Measured on a VLP-16 by reflectivity: 12.1 mm at 3-10 %, 8.5 at 10-30, 6.1 at 60-100.
  const LidarErrors vlp16 = make(drivers::VelodyneModel::kVlp16);
  CHECK(vlp16.noise_m(10.0, 0.06) == Approx(0.0121).epsilon(0.08));
  CHECK(vlp16.noise_m(10.0, 0.20) == Approx(0.0085).epsilon(0.03));
  CHECK(vlp16.noise_m(10.0, 0.80) == Approx(0.0061).epsilon(0.12));
}

TEST_CASE("grazing incidence shortens ranges as the waveform model says", "[lidar_errors]") {
  // Laconte et al.: table for an HDL-32E, mm at 10 m; the fit is within 25 %.
  for (const auto& [degrees, millimetres] :
       {std::pair(45.0, 3.0), {60.0, 7.5}, {70.0, 15.0}, {80.0, 38.0}, {85.0, 92.0}}) {
    INFO(degrees);
    const double shortening = incidence_shortening_m(10.0, std::cos(degrees * kRadiansPerDegree));
    CHECK(1000.0 * shortening == Approx(millimetres).epsilon(0.3));
  }
  CHECK(incidence_shortening_m(10.0, 1.0) < 1e-6);
  CHECK(incidence_shortening_m(40.0, std::cos(85.0 * kRadiansPerDegree)) == Approx(0.149).epsilon(0.3));
}

TEST_CASE("an echo at the threshold is detected half the time", "[lidar_errors]") {
  CHECK(detection_probability(1.0) == Approx(0.5));
  CHECK(detection_probability(4.0) > 0.999);
  CHECK(detection_probability(0.25) < 0.001);
  CHECK(detection_probability(0.0) == 0.0);
}
