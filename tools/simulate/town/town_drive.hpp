#pragma once

#include "nilio/core/se3.hpp"

#include "tools/simulate/geometry/scripted_drive.hpp"
#include "tools/simulate/scenes/scene.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <cstdint>
#include <vector>

namespace nilio::tools::simulate {

struct TownDriveConfig {
  std::uint64_t seed = 1;
  double cruise_speed_m_s = 10.0;
  /// Begin at cruising speed instead of from a halt.
  bool moving_start = false;
  DriveExtent extent;
  /// Brake with 1 g to a stop every 110 m and turn corners at 90 deg/s.
  bool hard = false;
  /// See SceneConfig.
  bool steady_body = false;
};

/// Control poses (every kControlIntervalS) of a drive through the streets of a town, in the right-hand lane.
/// Without a length it is one tour of about 640 m that uses a street twice in the same and once in the
/// opposite direction and ends at its start; a longer drive continues at random through the same streets. The
/// vehicle slows down for corners and stops at the end unless a duration ends the drive earlier.
std::vector<core::SE3> make_town_drive(const TownDriveConfig& config);

/// Drives through the town that follow a script instead of the street grid: stop_and_go, roundabout,
/// reversing, u_turn, three_point_turn and hill_hold. Empty for other scenes.
std::vector<DriveMove> town_script(SceneKind kind, double speed_m_s);

/// Poses of such a drive. Only the hill holds a slope of 12 %; the others have the town's relief.
std::vector<core::SE3> make_scripted_town_drive(SceneKind kind, const SceneConfig& config);

}  // namespace nilio::tools::simulate
