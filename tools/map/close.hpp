#pragma once

#include "nilio/core/result.hpp"

#include "tools/map/gnss.hpp"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "mapping/loops/loop_closure.hpp"
#include "mapping/map_correction.hpp"

namespace nilio::tools::map {

/// A candidate between the middle keyframes of two submaps.
struct ClosedLoop {
  mapping::Loop loop;
  core::Time reference_stamp;
  core::Time moving_stamp;
  core::SE3 T_reference_moving;  ///< between the poses of base_link at both keyframes
};

struct ClosedMap {
  std::vector<ClosedLoop> loops;          ///< all candidates, in the order of the search
  std::vector<std::uint32_t> ids;         ///< of the submaps
  std::vector<core::Time> stamps;         ///< of their middle keyframes
  std::vector<core::Vector6> deviations;  ///< of the odometry from each to the next, without biases
  double largest_correction_m = 0.0;
  double seconds = 0.0;
  double longest_submap_s = 0.0;  ///< search and solution of one submap
  std::optional<mapping::MapGnss> gnss;
  double gnss_rms_m = 0.0;  ///< horizontal distance of the positions that agree
};

/// Searches the loops of a map as nilio-mapper does, adds the positions of GNSS, or those that the map has
/// already, and writes the corrected poses into the map. Fails, and changes nothing, if most positions
/// contradict the map, and while a mapper writes it.
core::Result<ClosedMap> close(const std::filesystem::path& folder,
                              const std::optional<GnssInput>& gnss = std::nullopt);

/// The candidates as JSON.
std::string loops_json(const ClosedMap& map);

}  // namespace nilio::tools::map
