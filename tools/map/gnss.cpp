#include "tools/map/gnss.hpp"

#include "nilio/core/portable_math.hpp"
#include "nilio/core/units.hpp"

#include "tools/common/statistics.hpp"
#include "tools/common/text.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <vector>

namespace nilio::tools::map {

namespace {

using core::Error;
using core::Result;
using core::Vector3;
using mapping::MeasuredPosition;

// Below these, receivers' errors turn the map more than its odometry does.
constexpr double kMinPathMetres = 50.0;
constexpr double kMinExtentMetres = 20.0;
// Receivers state their noise, not reflections and the ionosphere; horizontal axis and up.
constexpr std::array kLeastDeviations{1.0, 2.0};
constexpr std::array kUnstatedDeviations{2.5, 5.0};
// Between keyframes, which are a metre apart in motion.
constexpr core::Duration kMaxGap = core::Duration::from_seconds(2.0);
// The file has the same bits on every processor.
constexpr double kDegreeSteps = 1e10;
constexpr double kMetreSteps = 1e4;

double rounded(double value, double steps) { return std::round(value * steps) / steps; }

mapping::Datum rounded(const gnss::GeodeticOrigin& origin) {
  return {rounded(origin.latitude_deg, kDegreeSteps), rounded(origin.longitude_deg, kDegreeSteps),
          rounded(origin.altitude_m, kMetreSteps), rounded(origin.heading_deg, kDegreeSteps)};
}

/// Positions near one place.
struct Samples {
  std::vector<Vector3> points;                           ///< the antenna in axes of the place
  std::array<std::vector<double>, 3> offsets;            ///< from the path in the map to the positions
  std::array<std::vector<double>, 2> stated_deviations;  ///< horizontal axis, up
};

double deviation_of(const std::vector<double>& stated, std::size_t axis) {
  return stated.empty() ? kUnstatedDeviations.at(axis) : std::max(median(stated), kLeastDeviations.at(axis));
}

MeasuredPosition position_of(const MapPlace& place, const Samples& samples) {
  MeasuredPosition position;
  position.node = place.id;
  for (const Vector3& point : samples.points) position.point += point;
  position.point /= static_cast<double>(samples.points.size());
  position.position = place.T_map_place * position.point;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto& offsets = samples.offsets.at(axis);
    auto& value = position.position[static_cast<Eigen::Index>(axis)];
    value = rounded(value + (offsets.empty() ? 0.0 : median(offsets)), kMetreSteps);
  }
  const double horizontal = deviation_of(samples.stated_deviations[0], 0);
  position.deviation << horizontal, horizontal,
      samples.offsets[2].empty() ? std::numeric_limits<double>::infinity()
                                 : deviation_of(samples.stated_deviations[1], 1);
  return position;
}

/// Path of the antenna where there are positions, and the largest distance from its first one.
Result<std::monostate> check_path(const gnss::Georeference& found, const std::string& name) {
  double path = 0.0;
  double extent = 0.0;
  const auto distance = [&](std::size_t a, std::size_t b) {
    return (found.matches[a].estimate - found.matches[b].estimate).head<2>().norm();
  };
  for (std::size_t i = 1; i < found.matches.size(); ++i) {
    path += distance(i, i - 1);
    extent = std::max(extent, distance(i, 0));
  }
  if (path >= kMinPathMetres && extent >= kMinExtentMetres) return std::monostate{};
  return Error{name +
               format(": positions along %.0f m of the map's path, %.0f m apart; %.0f m and %.0f m are "
                      "needed for its heading - use a longer drive, or check the receiver",
                      path, extent, kMinPathMetres, kMinExtentMetres)};
}

}  // namespace

Result<mapping::MapGnss> match_positions(const Trajectory& path, std::span<const MapPlace> places,
                                         const GnssInput& input) {
  gnss::GeoreferenceOptions options = input.options;
  options.max_gap = kMaxGap;
  const auto found = gnss::georeference(path, input.track, options);
  if (!found) return found.error();
  if (const auto checked = check_path(*found, input.track.name); !checked) return checked.error();
  mapping::MapGnss result;
  result.frame = rounded(found->origin);
  const bool has_altitudes =
      std::ranges::any_of(input.track.fixes, [](const gnss::Fix& fix) { return fix.altitude_m.has_value(); });
  result.altitude = !has_altitudes                ? mapping::AltitudeReference::kNone
                    : input.track.above_sea_level ? mapping::AltitudeReference::kSeaLevel
                                                  : mapping::AltitudeReference::kEllipsoid;
  const gnss::GeodeticFrame frame(origin_of(result.frame));
  std::map<std::size_t, Samples> samples;
  for (const gnss::Fix& fix : input.track.fixes) {
    const core::Time stamp = fix.stamp + options.time_offset;
    const auto pose = interpolate_pose(path, stamp, options.max_gap);
    if (!pose) continue;
    const auto next = std::lower_bound(places.begin(), places.end(), stamp,
                                       [](const MapPlace& p, core::Time wanted) { return p.stamp < wanted; });
    auto nearest = static_cast<std::size_t>(next - places.begin());
    const bool is_earlier_nearer =
        next == places.end() || (nearest > 0 && stamp - places[nearest - 1].stamp < next->stamp - stamp);
    if (is_earlier_nearer) --nearest;
    const Vector3 antenna = *pose * options.antenna;
    Samples& here = samples[nearest];
    here.points.push_back(places[nearest].T_map_place.inverse() * antenna);
    const Vector3 offset =
        frame.local(fix.latitude_deg, fix.longitude_deg, fix.altitude_m.value_or(result.frame.altitude_m)) -
        antenna;
    for (std::size_t axis = 0; axis < (fix.altitude_m ? 3U : 2U); ++axis)
      here.offsets.at(axis).push_back(offset[static_cast<Eigen::Index>(axis)]);
    if (const auto deviation = fix.horizontal_deviation_m()) here.stated_deviations[0].push_back(*deviation);
    if (fix.deviation_m && std::isfinite((*fix.deviation_m)[2]))
      here.stated_deviations[1].push_back((*fix.deviation_m)[2]);
  }
  for (const auto& [index, here] : samples) result.positions.push_back(position_of(places[index], here));
  return result;
}

mapping::Datum datum_of(const mapping::MapGnss& gnss, const core::SE3& T_frame_map) {
  const auto [latitude, longitude, altitude] =
      gnss::GeodeticFrame(origin_of(gnss.frame)).geodetic(T_frame_map.translation);
  const Eigen::Quaterniond& q = T_frame_map.rotation;
  const double heading = gnss.frame.heading_deg - 2.0 * portable::atan2(q.z(), q.w()) * kDegreesPerRadian;
  return rounded({latitude, longitude, altitude, heading - 360.0 * std::floor(heading / 360.0)});
}

}  // namespace nilio::tools::map
