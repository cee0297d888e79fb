#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/scan.hpp"

#include <cstdint>
#include <string>
#include <variant>

namespace nilio::tools::convert {

enum class PointFormat : std::uint8_t {
  kPcd,  ///< binary, version 0.7
  kPly,  ///< binary, little-endian
  kCsv,
};

/// "pcd", "ply", "csv".
const char* extension_of(PointFormat format);

/// Writes the points of a scan with the fields x, y, z (metres), intensity, ring, return
/// (Point::return_kind), time (seconds since Scan::start) and azimuth (of the point, degrees clockwise from
/// the x axis, 0 to 360). The file has its name only when it is complete. Errors name it.
core::Result<std::monostate> write_points(const core::Scan& scan, PointFormat format,
                                          const std::string& path);

}  // namespace nilio::tools::convert
