#include "tools/simulate/sensors/lidar_beam.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::tools::simulate {

using core::Vector3;

namespace {

/// Distances of the two-point calibration, m.
constexpr double kFarCalibrationM = 25.04;
constexpr double kNearCalibrationXM = 2.40;
constexpr double kNearCalibrationYM = 1.93;
/// Reference range of focal distances, m.
constexpr double kFocalRangeM = 131.0;
constexpr double kLargestRaw = 65535.0;

/// Correction at `away_m` from the axis minus the far one: linear between the two calibrations.
double near_correction(double far_m, double near_m, double away_m, double near_calibration_m) {
  const double slope = (far_m - near_m) / (kFarCalibrationM - near_calibration_m);
  return slope * (away_m - near_calibration_m) + near_m - far_m;
}

}  // namespace

BeamAzimuth BeamAzimuth::of(double azimuth_rad) { return {std::sin(azimuth_rad), std::cos(azimuth_rad)}; }

LidarBeam::LidarBeam(const drivers::LaserCalibration& laser, bool vertical_offset_across_beam)
    : laser_(laser),
      sin_elevation_(std::sin(laser.elevation_rad)),
      cos_elevation_(std::cos(laser.elevation_rad)),
      range_offset_(vertical_offset_across_beam ? -laser.vertical_offset_m * sin_elevation_ : 0.0),
      height_offset_(laser.vertical_offset_m * (vertical_offset_across_beam ? cos_elevation_ : 1.0)),
      bent_(laser.near_distance_correction_x_m != 0.0 || laser.near_distance_correction_y_m != 0.0) {}

Vector3 LidarBeam::origin(BeamAzimuth azimuth) const {
  // Azimuth 0 is +x; the horizontal offset is then towards +y.
  const double side = laser_.horizontal_offset_m;
  return {azimuth.cos * range_offset_ + azimuth.sin * side, azimuth.cos * side - azimuth.sin * range_offset_,
          height_offset_};
}

Vector3 LidarBeam::direction(BeamAzimuth azimuth) const {
  return {azimuth.cos * cos_elevation_, -azimuth.sin * cos_elevation_, sin_elevation_};
}

Vector3 LidarBeam::bend(double distance_m, BeamAzimuth azimuth) const {
  const Vector3 straight = origin(azimuth) + distance_m * direction(azimuth);
  // The manual's x is across (our -y), its y ahead (our x).
  const double far = laser_.distance_correction_m;
  const double across =
      near_correction(far, laser_.near_distance_correction_x_m, std::abs(straight.y()), kNearCalibrationXM);
  const double ahead =
      near_correction(far, laser_.near_distance_correction_y_m, std::abs(straight.x()), kNearCalibrationYM);
  return {ahead * cos_elevation_ * azimuth.cos, -across * cos_elevation_ * azimuth.sin,
          0.5 * (across + ahead) * sin_elevation_};
}

Vector3 LidarBeam::point(double distance_m, BeamAzimuth azimuth) const {
  const Vector3 straight = origin(azimuth) + distance_m * direction(azimuth);
  return bent_ && distance_m < kFarCalibrationM ? Vector3(straight + bend(distance_m, azimuth)) : straight;
}

Vector3 LidarBeam::direction_at(double range_m, BeamAzimuth azimuth) const {
  if (!bent_) return direction(azimuth);
  return (point(distance_for(range_m, azimuth), azimuth) - origin(azimuth)).normalized();
}

double LidarBeam::distance_for(double range_m, BeamAzimuth azimuth) const {
  if (!bent_ || range_m >= kFarCalibrationM) return range_m;
  // The correction changes by less than 1 % of the distance, so that this converges at once.
  double distance = range_m;
  for (int i = 0; i < 4; ++i) {
    const Vector3 bent = distance * direction(azimuth) + bend(distance, azimuth);
    distance += range_m - bent.norm();
  }
  // The correction ends with a step: ranges inside it have no distance of their own.
  return std::min(distance, kFarCalibrationM);
}

std::uint8_t LidarBeam::raw_intensity(double intensity, double raw) const {
  const double focus = 1.0 - laser_.focal_distance_m / kFocalRangeM;
  const double nearness = 1.0 - raw / kLargestRaw;
  const double added = laser_.focal_slope * 256.0 * std::abs(focus * focus - nearness * nearness);
  return static_cast<std::uint8_t>(std::clamp(intensity - added, 0.0, 255.0));
}

}  // namespace nilio::tools::simulate
