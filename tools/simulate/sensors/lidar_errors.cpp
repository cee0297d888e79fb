#include "tools/simulate/sensors/lidar_errors.hpp"

#include "nilio/core/units.hpp"

#include "tools/simulate/random.hpp"
#include "tools/simulate/sensors/optics.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nilio::tools::simulate {

namespace {

using drivers::VelodyneModel;

constexpr std::uint64_t kTableStream = 0x5461626C65;
/// Units are sorted out at the factory beyond this many standard deviations.
constexpr double kCut = 2.5;
/// Periods of the slow range drift: octaves around the time constant of 20 min.
constexpr std::array<double, 3> kDriftPeriodsS{1200.0, 2400.0, 4800.0};
/// Reflectance beyond which an echo is no longer dark, for the noise law.
constexpr double kLeastReflectance = 0.01;

RangeNoise noise_of(VelodyneModel model) {
  if (is_hdl64e(model)) return {0.008, 30.0, 0.0};
  if (model == VelodyneModel::kVls128) return {0.012, 0.0, 20.0};
  return {0.006, 0.0, 20.0};
}

TableErrors table_errors_of(VelodyneModel model) {
  if (is_hdl64e(model)) return {0.025, 0.10, 0.10, 0.10, 0.005};
  return {0.012, 0.03, 0.05, 0.03, 0.005};
}

TableErrors scaled(const TableErrors& e, Realism realism) {
  if (realism != Realism::kPoor) return e;
  return {2.0 * e.range_m, 2.0 * e.elevation_deg, 2.0 * e.azimuth_deg, 0.2, 2.0 * e.drift_m};
}

double cut_gaussian(RandomStream& random) {
  while (true) {
    const double value = random.gaussian();
    if (std::abs(value) < kCut) return value;
  }
}

}  // namespace

LidarErrors::LidarErrors(const drivers::VelodyneSensor& nominal, Realism realism, Effects effects,
                         std::uint64_t seed)
    : realism_(realism),
      effects_(effects),
      lasers_(nominal.lasers),
      range_m_(nominal.lasers.size(), 0.0),
      drift_(nominal.lasers.size()),
      noise_(noise_of(nominal.model)) {
  if (realism == Realism::kPoor) noise_.floor_m *= 2.0;
  if (!effects.has(Effect::kCalibration)) return;
  const TableErrors errors = scaled(table_errors_of(nominal.model), realism);
  RandomStream random(seed, kTableStream);
  const double common_rad = errors.common_elevation_deg * kRadiansPerDegree * cut_gaussian(random);
  for (std::size_t i = 0; i < lasers_.size(); ++i) {
    range_m_[i] = errors.range_m * cut_gaussian(random);
    lasers_[i].elevation_rad += common_rad + errors.elevation_deg * kRadiansPerDegree * cut_gaussian(random);
    lasers_[i].azimuth_correction_rad += errors.azimuth_deg * kRadiansPerDegree * cut_gaussian(random);
    for (double& phase : drift_[i].phase) phase = random.uniform(0.0, 2.0 * std::numbers::pi);
    // Three sines of equal amplitude a have a variance of 3 a^2 / 2.
    drift_[i].amplitude_m = errors.drift_m * std::sqrt(2.0 / 3.0);
  }
}

double LidarErrors::range_error_m(std::size_t laser, core::Duration time) const {
  double error = range_m_[laser];
  for (std::size_t k = 0; k < kDriftPeriodsS.size(); ++k) {
    error += drift_[laser].amplitude_m *
             std::sin(2.0 * std::numbers::pi * time.seconds() / kDriftPeriodsS[k] + drift_[laser].phase[k]);
  }
  return error;
}

double LidarErrors::noise_m(double range_m, double reflectance) const {
  double variance = noise_.floor_m * noise_.floor_m;
  if (noise_.doubling_range_m > 0.0) {
    const double share = range_m / noise_.doubling_range_m;
    variance *= 1.0 + share * share;
  }
  if (noise_.dark_percent > 0.0)
    variance *= 1.0 + noise_.dark_percent / (100.0 * std::max(reflectance, kLeastReflectance));
  return std::sqrt(variance);
}

double LidarErrors::noise_deviate(std::uint64_t word) {
  constexpr double kTailShare = 0.03;
  const double tail = to_unit_interval(mix_bits(word ^ 7U)) < kTailShare ? 3.0 : 1.0;
  return tail * to_gaussian(word);
}

double incidence_shortening_m(double range_m, double incidence_cosine) {
  // The fit holds up to 85 degrees; a limit of 88 degrees keeps the bias below 0.4 m.
  const double cosine = std::max(incidence_cosine, 0.035);
  const double tangent = std::sqrt(1.0 - std::min(1.0, cosine * cosine)) / cosine;
  return 0.003 * std::pow(tangent, 1.4) * (1.0 + range_m / 40.0 * tangent / 14.0);
}

double detection_probability(double signal) {
  if (signal <= 0.0) return 0.0;
  return 0.5 * std::erfc(-std::log(signal) / (0.3 * std::numbers::sqrt2));
}

}  // namespace nilio::tools::simulate
