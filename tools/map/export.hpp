#pragma once

#include "nilio/core/result.hpp"

#include "tools/gnss/geodetic.hpp"
#include "tools/map/cloud.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace nilio::tools::map {

enum class ExportFormat : std::uint8_t {
  kPly,  ///< binary: see mapping::ply_header()
  kPcd,  ///< 0.7, binary: fields of pcl::PointXYZINormal (curvature = thickness), and time
  kLas,  ///< 1.4, point format 6 with normals as extra bytes, 1 mm, intensity times 257
};

/// Format by the extension of a path: .ply, .pcd, .las. Fails for others.
core::Result<ExportFormat> format_of(const std::string& path);

/// Writes the points of a map, of one submap in memory at a time, and returns their number; `spacing_m`: see
/// mapping::points_of(). The file has its name when it is complete. Errors name what is damaged or cannot be
/// written.
core::Result<std::uint64_t> export_map(const mapping::MapReader& map, double spacing_m,
                                       const std::string& path);

/// Writes these points.
core::Result<std::monostate> write_cloud(const std::vector<CloudPoint>& cloud, const std::string& path);

/// Whether a path is written to a file of this name: .tum, .geojson or .kml.
bool is_path_file(const std::string& file);

/// Writes the poses as lines of TUM, or as a line of GeoJSON or KML, which need the origin's place.
core::Result<std::monostate> write_path(const Trajectory& path,
                                        const std::optional<gnss::GeodeticOrigin>& origin,
                                        const std::string& file);

}  // namespace nilio::tools::map
