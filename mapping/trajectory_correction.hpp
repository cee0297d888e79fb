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

}  // namespace nilio::mapping
