#include "tools/convert/geodetic.hpp"

#include "nilio/core/units.hpp"

#include <cmath>

namespace nilio::tools::convert {

namespace {

// WGS 84: half axes in metres, squares of the first and the second eccentricity.
constexpr double kEquator = 6378137.0;
constexpr double kFlattening = 1.0 / 298.257223563;
constexpr double kPole = kEquator * (1.0 - kFlattening);
constexpr double kFirst = kFlattening * (2.0 - kFlattening);
constexpr double kSecond = kFirst / (1.0 - kFirst);

}  // namespace

GeodeticFrame::GeodeticFrame(const GeodeticOrigin& origin) {
  const double latitude = origin.latitude_deg * kRadiansPerDegree;
  const double longitude = origin.longitude_deg * kRadiansPerDegree;
  const double sin_lat = std::sin(latitude);
  const double cos_lat = std::cos(latitude);
  const double sin_lon = std::sin(longitude);
  const double cos_lon = std::cos(longitude);
  const double normal = kEquator / std::sqrt(1.0 - kFirst * sin_lat * sin_lat);
  origin_ << (normal + origin.altitude_m) * cos_lat * cos_lon,
      (normal + origin.altitude_m) * cos_lat * sin_lon,
      (normal * (1.0 - kFirst) + origin.altitude_m) * sin_lat;
  const Eigen::Vector3d east(-sin_lon, cos_lon, 0.0);
  const Eigen::Vector3d north(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat);
  const double heading = origin.heading_deg * kRadiansPerDegree;
  R_earth_local_.col(0) = std::sin(heading) * east + std::cos(heading) * north;
  R_earth_local_.col(2) = east.cross(north);
  R_earth_local_.col(1) = R_earth_local_.col(2).cross(R_earth_local_.col(0));
}

std::array<double, 3> GeodeticFrame::geodetic(const Eigen::Vector3d& point) const {
  const Eigen::Vector3d p = origin_ + R_earth_local_ * point;
  const double distance = std::hypot(p.x(), p.y());
  const double parametric = std::atan2(p.z() * kEquator, distance * kPole);
  const double sin_p = std::sin(parametric);
  const double cos_p = std::cos(parametric);
  const double latitude = std::atan2(p.z() + kSecond * kPole * sin_p * sin_p * sin_p,
                                     distance - kFirst * kEquator * cos_p * cos_p * cos_p);
  const double sin_lat = std::sin(latitude);
  const double altitude = distance * std::cos(latitude) + p.z() * sin_lat -
                          kEquator * std::sqrt(1.0 - kFirst * sin_lat * sin_lat);
  return {latitude / kRadiansPerDegree, std::atan2(p.y(), p.x()) / kRadiansPerDegree, altitude};
}

}  // namespace nilio::tools::convert
