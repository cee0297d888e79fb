#pragma once

#include "nilio/core/result.hpp"

#include "tools/map/cloud.hpp"

#include <cstddef>
#include <filesystem>
#include <string>
#include <variant>
#include <vector>

namespace nilio::tools::map {

/// Figures of a map for `nilio map info`.
struct MapSummary {
  std::size_t submaps = 0;
  std::size_t keyframes = 0;  ///< each once
  std::size_t surfaces = 0;
  double path_m = 0.0;
  double megabytes = 0.0;
  core::Time first;
  core::Time last;
  Box bounds;
};
core::Result<MapSummary> summarise(const mapping::MapReader& map);

/// Writes the submaps whose surfaces lie in the box, without the surfaces outside of it, as a new map.
core::Result<std::monostate> crop(const mapping::MapReader& map, const Box& box,
                                  const std::filesystem::path& output);

/// Writes the submaps of several maps of the same frame as one new map, in the given order.
core::Result<std::monostate> merge(const std::vector<mapping::MapReader>& maps,
                                   const std::filesystem::path& output);

/// Differences between two maps of the same frame.
struct MapDifference {
  std::size_t both = 0;        ///< surfaces of the first with one of the second within a voxel
  std::size_t only_first = 0;  ///< surfaces of the first without
  std::size_t only_second = 0;
  /// Distance of the surfaces in both along their normals, root mean square, m.
  double distance_rms_m = 0.0;
  std::vector<CloudPoint>
      changes;  ///< those in one only; intensity 0: only in the first, 255: only in the second
};
/// Only space that both maps have seen is compared: places within `reach_m` of both paths.
core::Result<MapDifference> diff(const mapping::MapReader& first, const mapping::MapReader& second,
                                 double reach_m);

}  // namespace nilio::tools::map
