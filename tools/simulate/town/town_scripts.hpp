#pragma once

#include "tools/simulate/geometry/scripted_drive.hpp"
#include "tools/simulate/scenes/scene.hpp"

#include <vector>

namespace nilio::tools::simulate {

/// Drives through the town that follow a script instead of the street grid: stop_and_go, roundabout,
/// reversing, u_turn, three_point_turn and hill_hold. Empty for other scenes.
std::vector<DriveMove> town_script(SceneKind kind, double speed_m_s);

/// Poses of such a drive. Only the hill holds a slope of 12 %; the others have the town's relief.
std::vector<core::SE3> make_scripted_town_drive(SceneKind kind, const SceneConfig& config);

}  // namespace nilio::tools::simulate
