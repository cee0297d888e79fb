#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"

#include "tools/simulate/options.hpp"
#include "tools/simulate/scenes/scene.hpp"

namespace nilio::tools {

/// The drive that was asked for and its surroundings; warns on standard error of a pose file that leaves the
/// ground. `T_base_lidar` turns a pose file's camera poses into the vehicle's.
core::Result<simulation::Scene> make_scene(const SimulateArguments& arguments, const core::SE3& T_base_lidar);

}  // namespace nilio::tools
