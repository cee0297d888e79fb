#include "tools/simulate/geometry/scripted_drive.hpp"

#include <cmath>

namespace nilio::tools::simulate {

Route move_route(const DriveMove& move, const Vector2& from, double heading_rad) {
  // Steering takes about a metre on the way; at the ends, in standstill, the wheels turn on the spot, and the
  // heading goes on in the next move as it ended in this one.
  constexpr std::size_t kSteering = 4;
  std::vector<double> steps_m;
  std::vector<double> curvature;
  for (const DrivePiece& piece : move.pieces) {
    const auto count = static_cast<std::size_t>(std::max(1.0, std::round(piece.length_m / kRouteStepM)));
    steps_m.insert(steps_m.end(), count, piece.length_m / static_cast<double>(count));
    curvature.insert(curvature.end(), count, piece.curvature);
  }
  curvature = smooth(std::move(curvature), kSteering, 2);
  std::vector<Vector2> points{from};
  std::vector<double> heading{heading_rad};
  for (std::size_t i = 0; i < steps_m.size(); ++i) {
    const double turn = steps_m[i] * curvature[i];
    points.emplace_back(points.back() + steps_m[i] * direction(heading.back() + 0.5 * turn));
    heading.push_back(heading.back() + turn);
  }
  Route route = make_route(std::move(points), 0);
  route.heading = std::move(heading);
  return route;
}

std::vector<double> move_travel(const DriveMove& move, const Route& route) {
  DrivingStyle style;
  style.cruise_speed_m_s = move.speed_m_s;
  style.lateral_acceleration = move.lateral_acceleration;
  const double end = route.arc_length.back();
  return arc_length_over_time(route, speed_profile(route, end, style, move.halts_m), end, style);
}

}  // namespace nilio::tools::simulate
