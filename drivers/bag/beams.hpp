#pragma once

#include "nilio/drivers/bag/point_cloud.hpp"

#include "drivers/bag/columns.hpp"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::drivers::bag {

/// Where the number of a point's beam comes from.
enum class BeamSource : std::uint8_t {
  kField,   ///< a field, such as "ring"
  kRow,     ///< row of an organised cloud
  kColumn,  ///< column of a transposed one
  kNone,    ///< no beams of constant elevation, or unknown
};

/// Beams of a sensor, determined from its first clouds.
struct Beams {
  BeamSource source = BeamSource::kNone;
  std::string field;
  /// Rank by elevation, 0 = lowest, of each number.
  std::vector<std::uint16_t> rank_of;
  std::size_t count = 0;
  /// Vertical angle between neighbouring beams, median; without beams the median angle between the points of
  /// a narrow sector. rad.
  float spacing_rad = 0.0F;
};

/// Position of a point; empty if it is no return (not finite, or at the origin).
struct PositionColumns {
  Column x;
  Column y;
  Column z;
};
std::optional<std::array<float, 3>> position_of(const PositionColumns& columns, const std::uint8_t* point);

Beams find_beams(std::span<const CloudCopy> clouds, const PositionColumns& columns);

}  // namespace nilio::drivers::bag
