#include "tools/gnss/geodetic.hpp"

#include "nilio/core/portable_math.hpp"
#include "nilio/core/units.hpp"

#include <cmath>

namespace nilio::tools::gnss {

namespace {

// WGS 84: half axes in metres, squares of the first and the second eccentricity.
constexpr double kEquator = 6378137.0;
constexpr double kFlattening = 1.0 / 298.257223563;
constexpr double kPole = kEquator * (1.0 - kFlattening);
constexpr double kFirst = kFlattening * (2.0 - kFlattening);
constexpr double kSecond = kFirst / (1.0 - kFirst);

/// Earth-centred coordinates of a place.
Eigen::Vector3d earth_centred(double latitude, double longitude, double altitude_m) {
  const double sin_lat = portable::sin(latitude);
  const double normal = kEquator / std::sqrt(1.0 - kFirst * sin_lat * sin_lat);
  const double radius = (normal + altitude_m) * portable::cos(latitude);
  return {radius * portable::cos(longitude), radius * portable::sin(longitude),
          (normal * (1.0 - kFirst) + altitude_m) * sin_lat};
}

}  // namespace

GeodeticFrame::GeodeticFrame(const GeodeticOrigin& origin) {
  const double latitude = origin.latitude_deg * kRadiansPerDegree;
  const double longitude = origin.longitude_deg * kRadiansPerDegree;
  const double sin_lat = portable::sin(latitude);
  const double cos_lat = portable::cos(latitude);
  const double sin_lon = portable::sin(longitude);
  const double cos_lon = portable::cos(longitude);
  origin_ = earth_centred(latitude, longitude, origin.altitude_m);
  const Eigen::Vector3d east(-sin_lon, cos_lon, 0.0);
  const Eigen::Vector3d north(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat);
  const double heading = origin.heading_deg * kRadiansPerDegree;
  R_earth_local_.col(0) = portable::sin(heading) * east + portable::cos(heading) * north;
  R_earth_local_.col(2) = east.cross(north);
  R_earth_local_.col(1) = R_earth_local_.col(2).cross(R_earth_local_.col(0));
}

Eigen::Vector3d GeodeticFrame::local(double latitude_deg, double longitude_deg, double altitude_m) const {
  const Eigen::Vector3d p =
      earth_centred(latitude_deg * kRadiansPerDegree, longitude_deg * kRadiansPerDegree, altitude_m);
  return R_earth_local_.transpose() * (p - origin_);
}

std::array<double, 3> GeodeticFrame::geodetic(const Eigen::Vector3d& point) const {
  const Eigen::Vector3d p = origin_ + R_earth_local_ * point;
  const double distance = std::sqrt(p.x() * p.x() + p.y() * p.y());
  const double parametric = portable::atan2(p.z() * kEquator, distance * kPole);
  const double sin_p = portable::sin(parametric);
  const double cos_p = portable::cos(parametric);
  const double latitude = portable::atan2(p.z() + kSecond * kPole * sin_p * sin_p * sin_p,
                                          distance - kFirst * kEquator * cos_p * cos_p * cos_p);
  const double sin_lat = portable::sin(latitude);
  const double altitude = distance * portable::cos(latitude) + p.z() * sin_lat -
                          kEquator * std::sqrt(1.0 - kFirst * sin_lat * sin_lat);
  return {latitude / kRadiansPerDegree, portable::atan2(p.y(), p.x()) / kRadiansPerDegree, altitude};
}

}  // namespace nilio::tools::gnss
