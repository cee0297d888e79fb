#pragma once

#include "nilio/core/result.hpp"

#include "tools/common/trajectory.hpp"
#include "tools/gnss/georeference.hpp"
#include "tools/gnss/track.hpp"

#include <cstdint>
#include <span>

#include "mapping/map_correction.hpp"

namespace nilio::tools::map {

/// GNSS for a map, and how its times and positions are related to base_link.
struct GnssInput {
  gnss::Track track;
  gnss::GeoreferenceOptions options;
};

/// Place of a submap, see mapping::place_origin().
struct MapPlace {
  std::uint32_t id = 0;
  core::Time stamp;  ///< of its middle keyframe
  core::SE3 T_map_place;
};

/// One position for each place, in order of time: errors of a receiver are correlated over a place. It is the
/// median, over the track's positions nearest to the place, of their distance from the path. `path`: of
/// base_link in the map. Fails for tracks of other times and for paths that are too short to show a heading.
core::Result<mapping::MapGnss> match_positions(const Trajectory& path, std::span<const MapPlace> places,
                                               const GnssInput& input);

/// Place of the map when its frame lies so in that of the positions.
mapping::Datum datum_of(const mapping::MapGnss& gnss, const core::SE3& T_frame_map);

inline gnss::GeodeticOrigin origin_of(const mapping::Datum& datum) {
  return {datum.latitude_deg, datum.longitude_deg, datum.altitude_m, datum.heading_deg};
}

}  // namespace nilio::tools::map
