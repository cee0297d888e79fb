#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tools/simulate/geometry/mesh.hpp"
#include "tools/simulate/realism.hpp"

#include <array>
#include <cstdint>
#include <vector>

namespace nilio::tools::simulate {

/// Range noise, standard deviations in metres.
struct RangeNoise {
  double floor_m = 0.0;
  /// The noise grows as sqrt(1 + (range / this)^2); 0 = independent of the range.
  double doubling_range_m = 0.0;
  /// The noise grows as sqrt(1 + this / reflectivity in %); 0 = independent of the reflectivity.
  double dark_percent = 0.0;
};

/// Standard deviations of a unit's departures from its nominal laser table.
struct TableErrors {
  double range_m = 0.0;
  double elevation_deg = 0.0;
  double azimuth_deg = 0.0;
  /// Elevation error that all lasers share.
  double common_elevation_deg = 0.0;
  /// Slow drift of each laser's range, time constant 20 min.
  double drift_m = 0.0;
};

/// Errors of one LiDAR unit, drawn from a seed. The unit casts with its own laser table; receivers decode
/// with the nominal one. Sizes: HDL-64E fitted to KITTI's scans; other models from published calibration
/// studies (Glennie and Lichti 2010, Chan et al. 2013, Bula et al. 2020). Immutable.
class LidarErrors {
 public:
  LidarErrors(const drivers::VelodyneSensor& nominal, Realism realism, Effects effects, std::uint64_t seed);

  /// Lasers as they are in this unit.
  [[nodiscard]] const std::vector<drivers::LaserCalibration>& lasers() const { return lasers_; }
  /// Range error of a laser at a time, without noise; added to the true range.
  [[nodiscard]] double range_error_m(std::size_t laser, core::Duration time) const;
  /// Standard deviation of the white range noise.
  [[nodiscard]] double noise_m(double range_m, double reflectance) const;
  /// One deviate of the range noise, heavy-tailed as measured: 3 % of the shots have three times the noise.
  [[nodiscard]] static double noise_deviate(std::uint64_t word);
  [[nodiscard]] const Effects& effects() const { return effects_; }
  [[nodiscard]] Realism realism() const { return realism_; }

 private:
  struct Drift {
    std::array<double, 3> phase{};
    double amplitude_m = 0.0;
  };
  Realism realism_;
  Effects effects_;
  std::vector<drivers::LaserCalibration> lasers_;
  std::vector<double> range_m_;
  std::vector<Drift> drift_;
  RangeNoise noise_;
};

/// Metres by which a range is too short at grazing incidence: the echo of a slanted footprint peaks early
/// (Laconte et al., arXiv 1810.01619; fit to their model of an HDL-32E within 25 % up to 85 degrees).
double incidence_shortening_m(double range_m, double incidence_cosine);

/// Probability that an echo is detected, `signal` times the detection threshold: Phi(ln(signal) / 0.3).
double detection_probability(double signal);

}  // namespace nilio::tools::simulate
