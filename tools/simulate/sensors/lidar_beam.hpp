#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include <cstdint>

namespace nilio::tools::simulate {

/// Sine and cosine of a beam's azimuth, corrected by the laser's calibration.
struct BeamAzimuth {
  double sin = 0.0;
  double cos = 1.0;

  static BeamAzimuth of(double azimuth_rad);
};

/// Beam model of one laser: position of a return in the decoder, and its inverse, the packet's values for a
/// wanted point. Formulas of the HDL-64E manual (63-HDL64ES3, appendix F), which hold for the other models
/// with zeros. Points are in the sensor's ROS frame; metres. Immutable.
class LidarBeam {
 public:
  LidarBeam(const drivers::LaserCalibration& laser, bool vertical_offset_across_beam);

  [[nodiscard]] core::Vector3 origin(BeamAzimuth azimuth) const;
  /// Unit vector of the straight beam.
  [[nodiscard]] core::Vector3 direction(BeamAzimuth azimuth) const;
  /// Point at a distance: the measured one plus the far correction.
  [[nodiscard]] core::Vector3 point(double distance_m, BeamAzimuth azimuth) const;

  /// Whether the two-point correction bends the line of the near points.
  [[nodiscard]] bool bent() const { return bent_; }
  /// Unit vector from the origin to the point `range_m` away from it.
  [[nodiscard]] core::Vector3 direction_at(double range_m, BeamAzimuth azimuth) const;
  /// Distance, far correction included, whose point is nearest to `range_m` away from the origin.
  [[nodiscard]] double distance_for(double range_m, BeamAzimuth azimuth) const;
  /// Raw intensity for a point of raw distance `raw` that decodes to `intensity` (0 to 255), as near as the
  /// byte allows.
  [[nodiscard]] std::uint8_t raw_intensity(double intensity, double raw) const;

  [[nodiscard]] double far_correction_m() const { return laser_.distance_correction_m; }
  [[nodiscard]] double azimuth_correction_rad() const { return laser_.azimuth_correction_rad; }

 private:
  [[nodiscard]] core::Vector3 bend(double distance_m, BeamAzimuth azimuth) const;

  drivers::LaserCalibration laser_;
  double sin_elevation_;
  double cos_elevation_;
  double range_offset_;
  double height_offset_;
  bool bent_;
};

}  // namespace nilio::tools::simulate
