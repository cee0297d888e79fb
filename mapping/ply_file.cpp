#include "mapping/ply_file.hpp"

#include <fstream>

#include "mapping/point_cloud.hpp"

namespace nilio::mapping {

core::Result<std::uint64_t> write_ply(const MapReader& map, double spacing_m,
                                      const std::filesystem::path& path) {
  std::ofstream file(path, std::ios::binary);
  file << ply_header(0);
  std::uint64_t points = 0;
  for (const SubmapEntry& entry : map.submaps()) {
    const auto submap = map.load(entry);
    if (!submap) return submap.error();
    ByteWriter rows;
    for (const CloudPoint& point : points_of(*submap, entry.T_map_submap, spacing_m)) {
      put_ply_row(point, rows);
      ++points;
    }
    file.write(reinterpret_cast<const char*>(rows.bytes().data()),
               static_cast<std::streamsize>(rows.bytes().size()));
    // Readers count on the header: it follows the rows.
    if (!file.flush()) break;
    file.seekp(0);
    file << ply_header(points) << std::flush;
    file.seekp(0, std::ios::end);
  }
  if (file.flush()) return points;
  return core::Error{path.string() +
                     ": cannot be written - check that the folder is writable and the disk has space"};
}

}  // namespace nilio::mapping
