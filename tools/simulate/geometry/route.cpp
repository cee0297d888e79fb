#include "tools/simulate/geometry/route.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace nilio::tools::simulate {

using core::SE3;
using core::Vector3;

namespace {

/// Duration of a halt: two seconds.
constexpr std::size_t kHaltIntervals = 40;

/// Appends points every kRouteStepM from the last point to `end`.
void append_line(std::vector<Vector2>& line, const Vector2& end) {
  const Vector2 start = line.back();
  const auto count = static_cast<std::size_t>(std::max(1.0, std::round((end - start).norm() / kRouteStepM)));
  for (std::size_t i = 1; i <= count; ++i) {
    line.emplace_back(start + (end - start) * (static_cast<double>(i) / static_cast<double>(count)));
  }
}

}  // namespace

Vector2 right_of(const Vector2& direction) { return {direction.y(), -direction.x()}; }

std::vector<Vector2> round_corners(const std::vector<Vector2>& corners, const CornerRadii& radii,
                                   RandomStream random) {
  std::vector<Vector2> line{corners.front()};
  for (std::size_t i = 1; i + 1 < corners.size(); ++i) {
    const Vector2 in = (corners[i] - corners[i - 1]).normalized();
    const Vector2 out = (corners[i + 1] - corners[i]).normalized();
    const double cross = in.x() * out.y() - in.y() * out.x();
    const double turn = std::atan2(cross, in.dot(out));
    const double radius = std::abs(turn) < 0.5
                              ? 40.0
                              : (turn > 0.0 ? random.uniform(radii.left_low, radii.left_high)
                                            : random.uniform(radii.right_low, radii.right_high));
    const double tangent = radius * std::tan(0.5 * std::abs(turn));
    append_line(line, corners[i] - tangent * in);
    const Vector2 normal = turn > 0.0 ? Vector2(-right_of(in)) : right_of(in);
    const Vector2 start = line.back();
    const auto count = static_cast<int>(std::ceil(radius * std::abs(turn) / kRouteStepM));
    for (int k = 1; k <= count; ++k) {
      const double angle = std::abs(turn) * k / count;
      line.emplace_back(start + radius * (std::sin(angle) * in + (1.0 - std::cos(angle)) * normal));
    }
  }
  append_line(line, corners.back());
  return line;
}

Route make_route(std::vector<Vector2> points, std::size_t half_width) {
  Route route;
  route.points = smooth(std::move(points), half_width, 2);
  const std::size_t count = route.points.size();
  route.arc_length.assign(count, 0.0);
  route.heading.assign(count, 0.0);
  route.curvature.assign(count, 0.0);
  for (std::size_t i = 1; i < count; ++i) {
    route.arc_length[i] = route.arc_length[i - 1] + (route.points[i] - route.points[i - 1]).norm();
  }
  for (std::size_t i = 0; i < count; ++i) {
    const Vector2 d = route.points[std::min(i + 1, count - 1)] - route.points[i == 0 ? 0 : i - 1];
    const double heading = std::atan2(d.y(), d.x());
    const double previous = i == 0 ? heading : route.heading[i - 1];
    route.heading[i] = previous + std::remainder(heading - previous, 2.0 * std::numbers::pi);
  }
  for (std::size_t i = 1; i + 1 < count; ++i) {
    route.curvature[i] =
        (route.heading[i + 1] - route.heading[i - 1]) / (route.arc_length[i + 1] - route.arc_length[i - 1]);
  }
  return route;
}

std::vector<double> speed_profile(const Route& route, double stop_m, const DrivingStyle& style,
                                  const std::vector<double>& halts_m) {
  const std::size_t count = route.points.size();
  std::vector<double> speed;
  speed.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double corner =
        std::sqrt(style.lateral_acceleration / std::max(std::abs(route.curvature[i]), 1e-6));
    const double left = std::max(0.0, stop_m - route.arc_length[i]);
    const bool stands = i == 0 && !style.moving_start;
    speed.push_back(
        stands ? 0.0 : std::min({style.cruise_speed_m_s, corner, std::sqrt(2.0 * style.braking * left)}));
  }
  for (const double halt_m : halts_m) {
    const auto at = std::lower_bound(route.arc_length.begin(), route.arc_length.end(), halt_m);
    if (at != route.arc_length.end()) speed[static_cast<std::size_t>(at - route.arc_length.begin())] = 0.0;
  }
  for (std::size_t i = 1; i < count; ++i) {
    const double ds = route.arc_length[i] - route.arc_length[i - 1];
    speed[i] = std::min(speed[i], std::sqrt(speed[i - 1] * speed[i - 1] + 2.0 * style.acceleration * ds));
  }
  for (std::size_t i = count - 1; i > 0; --i) {
    const double ds = route.arc_length[i] - route.arc_length[i - 1];
    speed[i - 1] = std::min(speed[i - 1], std::sqrt(speed[i] * speed[i] + 2.0 * style.braking * ds));
  }
  return speed;
}

std::vector<double> arc_length_over_time(const Route& route, const std::vector<double>& speed, double stop_m,
                                         const DrivingStyle& style) {
  std::vector<double> result;
  const auto stationary = static_cast<std::size_t>(std::lround(kStationaryTimeS / kControlIntervalS));
  if (!style.moving_start) result.assign(stationary, 0.0);
  double segment_start = 0.0;
  double next = 0.0;
  for (std::size_t i = 1; i < speed.size() && route.arc_length[i - 1] < stop_m; ++i) {
    const double ds = route.arc_length[i] - route.arc_length[i - 1];
    const double sum = speed[i] + speed[i - 1];
    if (sum <= 1e-9) break;
    const double dt = 2.0 * ds / sum;
    const double acceleration = (speed[i] - speed[i - 1]) / dt;
    for (; next <= segment_start + dt; next += kControlIntervalS) {
      const double t = next - segment_start;
      result.push_back(route.arc_length[i - 1] + speed[i - 1] * t + 0.5 * acceleration * t * t);
    }
    segment_start += dt;
    const bool halts = speed[i] <= 0.0 && route.arc_length[i] < stop_m;
    for (std::size_t k = 0; halts && k < kHaltIntervals; ++k) result.push_back(route.arc_length[i]);
  }
  const double end = result.empty() ? 0.0 : result.back();
  result.insert(result.end(), stationary, end);
  return smooth(std::move(result), style.pedal_half_width, 2);
}

RoutePoint route_at(const Route& route, double arc_length) {
  const auto upper = std::upper_bound(route.arc_length.begin() + 1, route.arc_length.end() - 1, arc_length);
  const auto b = static_cast<std::size_t>(upper - route.arc_length.begin());
  const std::size_t a = b - 1;
  const double share = (arc_length - route.arc_length[a]) / (route.arc_length[b] - route.arc_length[a]);
  return {route.points[a] + share * (route.points[b] - route.points[a]),
          std::lerp(route.heading[a], route.heading[b], share),
          std::lerp(route.curvature[a], route.curvature[b], share)};
}

SE3 place_vehicle(const RoutePoint& at, const GroundSlope& ground, double time_s, double speed,
                  double acceleration, double cruise_speed) {
  const double tau = 2.0 * std::numbers::pi * time_s;
  const double liveliness = speed / cruise_speed;
  const Vector2 forward(std::cos(at.heading), std::sin(at.heading));
  const Vector2& slope = ground.gradient;
  const double pitch = -std::atan(slope.dot(forward)) - 0.004 * acceleration +
                       liveliness * (0.0026 * std::sin(1.13 * tau) + 0.0015 * std::sin(1.71 * tau + 1.0));
  const double roll = -std::atan(slope.dot(right_of(forward))) + 0.006 * speed * speed * at.curvature +
                      liveliness * (0.0022 * std::sin(1.37 * tau + 2.0) + 0.0012 * std::sin(1.93 * tau));
  const double heave = 0.008 * liveliness * std::sin(1.29 * tau + 0.5);
  SE3 T_world_base;
  T_world_base.rotation = Eigen::AngleAxisd(at.heading, Vector3::UnitZ()) *
                          Eigen::AngleAxisd(pitch, Vector3::UnitY()) *
                          Eigen::AngleAxisd(roll, Vector3::UnitX());
  T_world_base.translation << at.position, ground.height + heave;
  return T_world_base;
}

}  // namespace nilio::tools::simulate
