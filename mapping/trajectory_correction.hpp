#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <cstddef>
#include <filesystem>

#include "mapping/map_folder.hpp"

namespace nilio::mapping {

/// Moves the trajectory of a run, a file in the format of TUM in odom, along with the submaps of its map:
/// each pose between the corrections of the two nearest submaps. Returns the number of poses. The files are
/// not trusted.
core::Result<std::size_t> correct_trajectory(const MapReader& map, const std::filesystem::path& trajectory,
                                             const std::filesystem::path& output);

/// Moves a trajectory into the frame of a saved map. `localisation`: lines of stamp and T_map_odom as in a
/// trajectory, more columns may follow; a pose gets the last one before it, so that it depends on nothing
/// later. Poses before the first one are left out. Returns the number of poses.
core::Result<std::size_t> localise_trajectory(const std::filesystem::path& localisation,
                                              const std::filesystem::path& trajectory,
                                              const std::filesystem::path& output);

}  // namespace nilio::mapping
