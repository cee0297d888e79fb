#pragma once

#include "nilio/core/result.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <string>

#include "mapping/bytes.hpp"
#include "mapping/submap.hpp"

namespace nilio::mapping {

/// Identity of a map: random, in all of its files.
using MapId = std::array<std::uint8_t, 16>;

/// A submap in the file format of docs/map_format.md: a header with checksum, and the keyframes and surfaces,
/// each with its own. Surfaces are quantised to 10 to 13 bytes: mean 2 mm (plane) or 4 mm, normal about 0.5
/// degrees, thickness and number of points 3 %, intensity 1.
Bytes encode_submap(const Submap& submap, const MapId& map, core::Time created);

/// The submap and the map it belongs to. The surfaces may be skipped, which reads only what `info` needs.
struct DecodedSubmap {
  Submap submap;
  MapId map{};
  core::Time created;
};
/// `name` begins the error message. The bytes are not trusted.
core::Result<DecodedSubmap> decode_submap(std::span<const std::uint8_t> bytes, const std::string& name);

/// 16 bits of a unit vector: its octahedral projection. For the tests.
std::uint16_t encode_normal(const Eigen::Vector3f& normal);
Eigen::Vector3f decode_normal(std::uint16_t code);

}  // namespace nilio::mapping
