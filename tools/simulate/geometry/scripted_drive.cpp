#include "tools/simulate/geometry/scripted_drive.hpp"

#include <cmath>

namespace nilio::tools::simulate {

Route move_route(const DriveMove& move, const Vector2& from, double heading_rad) {
  // Steering takes about a metre; the smoothing keeps the ends.
  constexpr std::size_t kSteering = 4;
  std::vector<Vector2> points{from};
  double heading = heading_rad;
  for (const DrivePiece& piece : move.pieces) {
    const auto steps = static_cast<std::size_t>(std::max(1.0, std::round(piece.length_m / kRouteStepM)));
    const double step = piece.length_m / static_cast<double>(steps);
    for (std::size_t i = 0; i < steps; ++i) {
      points.emplace_back(points.back() + step * direction(heading + 0.5 * step * piece.curvature));
      heading += step * piece.curvature;
    }
  }
  return make_route(std::move(points), kSteering);
}

std::vector<double> move_travel(const DriveMove& move, const Route& route) {
  DrivingStyle style;
  style.cruise_speed_m_s = move.speed_m_s;
  style.lateral_acceleration = move.lateral_acceleration;
  const double end = route.arc_length.back();
  return arc_length_over_time(route, speed_profile(route, end, style, move.halts_m), end, style);
}

}  // namespace nilio::tools::simulate
