#pragma once

#include "nilio/core/se3.hpp"

#include "tools/simulate/random.hpp"
#include "tools/simulate/town/street_layout.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace nilio::tools::simulate {

/// Distance between the points of a route.
inline constexpr double kRouteStepM = 0.25;

/// A plane curve with arc length, heading and curvature; points kRouteStepM apart.
struct Route {
  std::vector<Vector2> points;
  std::vector<double> arc_length;
  std::vector<double> heading;    ///< unwrapped, rad
  std::vector<double> curvature;  ///< 1/m, left positive
};

/// Ranges of the corner radii to either side, metres.
struct CornerRadii {
  double left_low = 10.5;
  double left_high = 12.5;
  double right_low = 8.0;
  double right_high = 9.5;
};

/// Place, heading and curvature at an arc length.
struct RoutePoint {
  Vector2 position;
  double heading = 0.0;
  double curvature = 0.0;
};

/// Height and gradient of the ground at a point.
struct GroundSlope {
  double height = 0.0;
  Vector2 gradient = Vector2::Zero();
};

/// Limits of the driver model; m/s and m/s^2.
struct DrivingStyle {
  double cruise_speed_m_s = 10.0;
  double lateral_acceleration = 2.4;
  double acceleration = 1.8;
  double braking = 2.2;
  /// Half width of the moving average that limits the jerk, control intervals; it is applied twice. 6
  /// resembles normal use of the pedals.
  std::size_t pedal_half_width = 6;
  /// Begin at cruising speed instead of from a halt.
  bool moving_start = false;
};

/// Moving average over 2 * half_width + 1 values, `passes` times. Beyond its ends the sequence is continued
/// by point reflection.
template <class T>
std::vector<T> smooth(std::vector<T> values, std::size_t half_width, int passes) {
  const auto count = static_cast<std::ptrdiff_t>(values.size());
  const auto at = [&](std::ptrdiff_t i) -> T {
    if (i < 0) return 2.0 * values.front() - values[static_cast<std::size_t>(std::min(-i, count - 1))];
    if (i >= count) {
      return 2.0 * values.back() -
             values[static_cast<std::size_t>(std::max<std::ptrdiff_t>(2 * count - 2 - i, 0))];
    }
    return values[static_cast<std::size_t>(i)];
  };
  const auto half = static_cast<std::ptrdiff_t>(half_width);
  for (int pass = 0; pass < passes; ++pass) {
    std::vector<T> result(values.size());
    for (std::ptrdiff_t i = 0; i < count; ++i) {
      T sum = at(i - half);
      for (std::ptrdiff_t k = i - half + 1; k <= i + half; ++k) sum += at(k);
      result[static_cast<std::size_t>(i)] = sum / static_cast<double>(2 * half + 1);
    }
    values = std::move(result);
  }
  return values;
}

Vector2 right_of(const Vector2& direction);

/// Replaces the corners of a polyline by arcs.
std::vector<Vector2> round_corners(const std::vector<Vector2>& corners, const CornerRadii& radii,
                                   RandomStream random);

/// `half_width` of the smoothing in points; 10 turns steps of curvature into ramps of 10 m, as steering does.
Route make_route(std::vector<Vector2> points, std::size_t half_width = 10);

RoutePoint route_at(const Route& route, double arc_length);

/// Fastest speed along the route within the acceleration limits; zero at `stop_m` and at each of `halts_m`.
std::vector<double> speed_profile(const Route& route, double stop_m, const DrivingStyle& style,
                                  const std::vector<double>& halts_m = {});

/// Arc length at every control instant: stationary, driving, stationary.
std::vector<double> arc_length_over_time(const Route& route, const std::vector<double>& speed, double stop_m,
                                         const DrivingStyle& style);

/// Poses of a vehicle at the arc lengths `travelled`, one per control instant, on the ground given by
/// `ground(arc length, position)`. The body sways with speed and pitches and rolls with acceleration.
template <class GroundAt>
std::vector<core::SE3> drive_over(const Route& route, const std::vector<double>& travelled,
                                  double cruise_speed, const GroundAt& ground);

/// One control pose of drive_over().
core::SE3 place_vehicle(const RoutePoint& at, const GroundSlope& ground, double time_s, double speed,
                        double acceleration, double cruise_speed);

template <class GroundAt>
std::vector<core::SE3> drive_over(const Route& route, const std::vector<double>& travelled,
                                  double cruise_speed, const GroundAt& ground) {
  std::vector<core::SE3> poses;
  poses.reserve(travelled.size());
  for (std::size_t i = 0; i < travelled.size(); ++i) {
    const double before = i == 0 ? 2.0 * travelled[0] - travelled[1] : travelled[i - 1];
    const double after = i + 1 == travelled.size() ? 2.0 * travelled[i] - before : travelled[i + 1];
    const double v = (after - before) / (2.0 * kControlIntervalS);
    const double a = (after - 2.0 * travelled[i] + before) / (kControlIntervalS * kControlIntervalS);
    const RoutePoint at = route_at(route, travelled[i]);
    poses.push_back(place_vehicle(at, ground(travelled[i], at.position),
                                  static_cast<double>(i) * kControlIntervalS, v, a, cruise_speed));
  }
  return poses;
}

}  // namespace nilio::tools::simulate
