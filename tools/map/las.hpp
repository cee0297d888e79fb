#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "mapping/bytes.hpp"
#include "mapping/point_cloud.hpp"

namespace nilio::tools::map {

/// Coordinates of a LAS file: whole millimetres from an offset.
struct LasCoordinates {
  core::Vector3 offset = core::Vector3::Zero();
  std::array<std::int32_t, 3> minimum{};
  std::array<std::int32_t, 3> maximum{};
  std::uint64_t points = 0;
};

/// Header and variable length records of a LAS 1.4 file (ASPRS 2019, R15) in point format 6 with the normal
/// as three floats of extra bytes. Of the same length for all coordinates.
std::string las_header(const LasCoordinates& coordinates);
/// Appends a point and counts it. Positions beyond 2,147 km from the offset are clamped.
void put_las_point(const mapping::CloudPoint& point, LasCoordinates& coordinates, mapping::ByteWriter& out);

}  // namespace nilio::tools::map
