#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <cstddef>
#include <filesystem>
#include <optional>

#include "mapping/map_folder.hpp"

namespace nilio::mapping {

/// Completes a map whose mapper was killed from the keyframes of its open submaps. Returns their number.
/// Fails while a mapper writes the map. `now`: see MapWriter.
core::Result<std::size_t> recover_map(const std::filesystem::path& folder, core::Time now);

/// T_map_base of the last keyframe; empty if the last submap cannot be read.
std::optional<core::SE3> last_pose(const MapReader& map);

}  // namespace nilio::mapping
