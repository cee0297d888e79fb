#include "tools/map/cloud.hpp"

namespace nilio::tools::map {

core::Result<std::vector<CloudPoint>> read_cloud(const mapping::MapReader& map) {
  std::vector<CloudPoint> cloud;
  for (const mapping::SubmapEntry& entry : map.submaps()) {
    const auto submap = map.load(entry);
    if (!submap) return submap.error();
    const std::vector<CloudPoint> points = points_of(*submap, entry.T_map_submap);
    cloud.insert(cloud.end(), points.begin(), points.end());
  }
  return cloud;
}

core::Result<Trajectory> read_path(const mapping::MapReader& map) {
  Trajectory path;
  for (const mapping::SubmapEntry& entry : map.submaps()) {
    const auto submap = map.load(entry);
    if (!submap) return submap.error();
    add_path(submap->keyframes, entry.T_map_submap, path);
  }
  return path;
}

void add_path(std::span<const mapping::SubmapKeyframe> keyframes, const core::SE3& T_map_submap,
              Trajectory& path) {
  for (const mapping::SubmapKeyframe& keyframe : keyframes) {
    // Submaps overlap: the earlier one has told of the first half already.
    if (!path.stamps.empty() && keyframe.stamp <= path.stamps.back()) continue;
    path.stamps.push_back(keyframe.stamp);
    path.poses.emplace_back((T_map_submap * keyframe.T_submap_base).matrix());
  }
}

}  // namespace nilio::tools::map
