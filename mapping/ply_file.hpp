#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <filesystem>

#include "mapping/map_folder.hpp"

namespace nilio::mapping {

/// Spacing of map.ply of a run, metres: three points by three on a plane voxel.
inline constexpr double kRunPlySpacingMetres = 0.17;

/// Writes the surfaces of a map as ply_header() has it and returns the number of points; `spacing_m`: see
/// points_of(). The number in the header follows each submap, so that an abrupt end leaves a whole file of
/// the first submaps.
core::Result<std::uint64_t> write_ply(const MapReader& map, double spacing_m,
                                      const std::filesystem::path& path);

}  // namespace nilio::mapping
