#include "tools/map/export.hpp"

#include "tools/common/files.hpp"
#include "tools/convert/run.hpp"
#include "tools/map/cloud_file.hpp"

#include <limits>
#include <span>

namespace nilio::tools::map {

using core::Error;
using core::Result;

Result<ExportFormat> format_of(const std::string& path) {
  if (path.ends_with(".ply")) return ExportFormat::kPly;
  if (path.ends_with(".pcd")) return ExportFormat::kPcd;
  if (path.ends_with(".las")) return ExportFormat::kLas;
  return Error{path +
               ": the extension chooses the format - name a .ply, .pcd or .las file, or .tum, .geojson or "
               ".kml for the path"};
}

Result<std::uint64_t> export_map(const mapping::MapReader& map, double spacing_m, const std::string& path) {
  const auto format = format_of(path);
  if (!format) return format.error();
  core::Vector3 low = core::Vector3::Constant(std::numeric_limits<double>::infinity());
  core::Vector3 high = -low;
  for (const mapping::SubmapEntry& entry : map.submaps()) {
    low = low.cwiseMin(entry.T_map_submap.translation);
    high = high.cwiseMax(entry.T_map_submap.translation);
  }
  const core::Vector3 centre =
      map.submaps().empty() ? core::Vector3::Zero() : core::Vector3(0.5 * (low + high));
  CloudFile file(path, *format, centre);
  for (const mapping::SubmapEntry& entry : map.submaps()) {
    const auto submap = map.load(entry);
    if (!submap) return submap.error();
    file.add(points_of(*submap, entry.T_map_submap, spacing_m));
  }
  if (const auto written = file.finish(); !written) return written.error();
  return file.points();
}

Result<std::monostate> write_cloud(const std::vector<CloudPoint>& cloud, const std::string& path) {
  const auto format = format_of(path);
  if (!format) return format.error();
  CloudFile file(path, *format, cloud.empty() ? core::Vector3::Zero() : cloud.front().position);
  file.add(cloud);
  return file.finish();
}

bool is_path_file(const std::string& file) {
  return file.ends_with(".tum") || file.ends_with(".geojson") || file.ends_with(".kml");
}

Result<std::monostate> write_path(const Trajectory& path, const std::optional<gnss::GeodeticOrigin>& origin,
                                  const std::string& file) {
  if (file.ends_with(".tum")) return write_text(file, trajectory_text(path));
  if (!origin)
    return Error{file +
                 ": has longitudes and latitudes - give the map's place with --origin, or by nilio map close "
                 "--gnss, or write .tum"};
  if (path.poses.size() < 2) return Error{file + ": a line has two points, the map has fewer poses"};
  return write_text(file, file.ends_with(".kml") ? convert::kml_text(path, *origin)
                                                 : convert::geojson_text(path, "path", *origin));
}

}  // namespace nilio::tools::map
