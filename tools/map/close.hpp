#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "mapping/loops/loop_closure.hpp"

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
};

/// Searches the loops of a map as nilio-mapper does and writes the corrected poses into the map. Fails while
/// a mapper writes the map.
core::Result<ClosedMap> close(const std::filesystem::path& folder);

/// The candidates as JSON.
std::string loops_json(const ClosedMap& map);

}  // namespace nilio::tools::map
