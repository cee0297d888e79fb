#pragma once

#include "tools/simulate/geometry/route.hpp"

#include <vector>

namespace nilio::tools::simulate {

/// A piece of a drive with constant curvature (1/m, left positive).
struct DrivePiece {
  double length_m = 0.0;
  double curvature = 0.0;
};

/// Pieces driven in one go, from standstill to standstill, forwards or backwards. A left curve turns the
/// direction of travel to the left.
struct DriveMove {
  std::vector<DrivePiece> pieces;
  double speed_m_s = 8.0;
  bool reverse = false;
  /// Stops on the way, each for 2 s.
  std::vector<double> halts_m;
  double lateral_acceleration = 2.4;
};

/// Poses every kControlIntervalS of moves one after the other, with 2 s of standstill before and after each,
/// on the ground given by `ground(position)`. The drive begins at the origin along x.
template <class GroundAt>
std::vector<core::SE3> scripted_drive(const std::vector<DriveMove>& moves, double sway_speed,
                                      const GroundAt& ground);

/// Route of a move from a place and heading of travel.
Route move_route(const DriveMove& move, const Vector2& from, double heading_rad);
/// Distance at every control instant.
std::vector<double> move_travel(const DriveMove& move, const Route& route);

template <class GroundAt>
std::vector<core::SE3> scripted_drive(const std::vector<DriveMove>& moves, double sway_speed,
                                      const GroundAt& ground) {
  std::vector<core::SE3> poses;
  Vector2 place = Vector2::Zero();
  double travel_heading = 0.0;
  for (std::size_t m = 0; m < moves.size(); ++m) {
    const DriveMove& move = moves[m];
    if (m > 0 && move.reverse != moves[m - 1].reverse) travel_heading += std::numbers::pi;
    const Route route = move_route(move, place, travel_heading);
    const std::vector<double> travelled = move_travel(move, route);
    std::vector<core::SE3> part = drive_over(
        route, travelled, sway_speed, [&](double, const Vector2& p) -> GroundSlope { return ground(p); });
    if (move.reverse) {
      // The body looks backwards: pitch and roll change their signs with the turn by half a revolution.
      const Eigen::Quaterniond about(Eigen::AngleAxisd(std::numbers::pi, core::Vector3::UnitZ()));
      for (core::SE3& pose : part) pose.rotation = pose.rotation * about;
    }
    poses.insert(poses.end(), part.begin(), part.end());
    place = route.points.back();
    travel_heading = route.heading.back();
  }
  return poses;
}

}  // namespace nilio::tools::simulate
