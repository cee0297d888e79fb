#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "mapping/bytes.hpp"
#include "mapping/loops/loop_closure.hpp"
#include "mapping/submap_codec.hpp"

namespace nilio::mapping {

/// Place of a frame on the WGS 84 ellipsoid; its z axis is up.
struct Datum {
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  double altitude_m = 0.0;
  double heading_deg = 0.0;  ///< of the x axis, clockwise from north
};

/// Zero of the altitudes.
enum class AltitudeReference : std::uint8_t { kEllipsoid, kSeaLevel, kNone };

/// Positions of a GNSS receiver in a map.
struct MapGnss {
  Datum datum;  ///< of the map
  AltitudeReference altitude = AltitudeReference::kEllipsoid;
  Datum frame;                              ///< of the positions
  std::vector<MeasuredPosition> positions;  ///< empty: part of another map, or several
};

/// Poses of submaps after loop closure, and the loops that are verified, which a later mapper continues with.
struct MapCorrection {
  /// Ids in ascending order, and T_map_submap.
  std::vector<std::pair<std::uint32_t, core::SE3>> poses;
  std::vector<Loop> loops;
  std::optional<MapGnss> gnss;
};

/// Poses and verified loops so far.
MapCorrection correction_of(const LoopCloser& closer);

/// The content of the file `poses` of a map, see docs/map.md.
Bytes encode_correction(const MapCorrection& correction, const MapId& map);
/// The bytes are not trusted; a file of another map is an error. `name` begins the message.
core::Result<MapCorrection> decode_correction(std::span<const std::uint8_t> bytes, const MapId& map,
                                              const std::string& name);

}  // namespace nilio::mapping
