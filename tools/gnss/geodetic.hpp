#pragma once

#include <array>

#include <Eigen/Geometry>

namespace nilio::tools::gnss {

/// Place of a local frame on the WGS 84 ellipsoid; its z axis is up.
struct GeodeticOrigin {
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  double altitude_m = 0.0;   ///< above the ellipsoid
  double heading_deg = 0.0;  ///< of the x axis, clockwise from north
};

/// Latitude and longitude in degrees and altitude in metres of points of a local frame (Bowring 1976).
/// Immutable.
class GeodeticFrame {
 public:
  explicit GeodeticFrame(const GeodeticOrigin& origin);

  [[nodiscard]] std::array<double, 3> geodetic(const Eigen::Vector3d& point) const;
  /// The inverse: a place in the local frame.
  [[nodiscard]] Eigen::Vector3d local(double latitude_deg, double longitude_deg, double altitude_m) const;

 private:
  Eigen::Vector3d origin_;  ///< earth-centred
  Eigen::Matrix3d R_earth_local_;
};

}  // namespace nilio::tools::gnss
