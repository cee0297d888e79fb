#include "mapping/point_cloud.hpp"

#include <algorithm>
#include <cmath>

#include "mapping/voxel_key.hpp"

namespace nilio::mapping {

namespace {

/// Calls add(position) for the points of a grid on the plane, in its voxel. The grid lies in the two axes
/// that the plane is least inclined to.
template <class Add>
void fill_voxel(const Surface& surface, int cells, const Add& add) {
  const Eigen::Vector3f centre = centre_of(index_at(surface.mean, kPlaneVoxelMetres), kPlaneVoxelMetres);
  Eigen::Index up = 0;
  surface.normal.cwiseAbs().maxCoeff(&up);
  const Eigen::Index u = (up + 1) % 3;
  const Eigen::Index v = (up + 2) % 3;
  const float step = kPlaneVoxelMetres / static_cast<float>(cells);
  const auto offset = [&](int i) { return (static_cast<float>(i) + 0.5F) * step - 0.5F * kPlaneVoxelMetres; };
  for (int i = 0; i < cells * cells; ++i) {
    Eigen::Vector3f p = centre;
    p[u] += offset(i % cells);
    p[v] += offset(i / cells);
    p[up] = surface.mean[up] -
            (surface.normal[u] * (p[u] - surface.mean[u]) + surface.normal[v] * (p[v] - surface.mean[v])) /
                surface.normal[up];
    if (std::abs(p[up] - centre[up]) <= 0.5F * kPlaneVoxelMetres) add(p);
  }
}

}  // namespace

std::vector<CloudPoint> points_of(const Submap& submap, const core::SE3& T_map_submap, double spacing_m) {
  const double cells = spacing_m > 0.0 ? static_cast<double>(kPlaneVoxelMetres) / spacing_m : 1.0;
  std::vector<CloudPoint> points;
  points.reserve(submap.surfaces.size());
  for (const Surface& surface : submap.surfaces) {
    CloudPoint point;
    point.normal = (T_map_submap.rotation * surface.normal.cast<double>()).cast<float>();
    point.intensity = surface.intensity;
    point.thickness_m = surface.thickness_m;
    if (surface.keyframe < submap.keyframes.size()) point.stamp = submap.keyframes[surface.keyframe].stamp;
    const auto add = [&](const Eigen::Vector3f& position) {
      point.position = T_map_submap * position.cast<double>();
      points.push_back(point);
    };
    if (surface.is_plane && cells > 1.0)
      fill_voxel(surface, static_cast<int>(std::lround(cells)), add);
    else
      add(surface.mean);
  }
  return points;
}

std::uint8_t grey_of(const CloudPoint& point) {
  return static_cast<std::uint8_t>(std::clamp(std::lround(point.intensity), 0L, 255L));
}

std::string ply_header(std::uint64_t points) {
  const std::string before = "ply\nformat binary_little_endian 1.0\ncomment nilio ";
  std::string after = "\nelement vertex " + std::to_string(points) + "\n";
  for (const char* const name : {"x", "y", "z", "nx", "ny", "nz", "intensity"})
    after += std::string("property float ") + name + "\n";
  for (const char* const name : {"red", "green", "blue"})
    after += std::string("property uchar ") + name + "\n";
  after += "property double gps_time\nend_header\n";
  // A comment fills it up.
  return before + std::string(kPlyHeaderBytes - before.size() - after.size(), '.') + after;
}

void put_ply_row(const CloudPoint& point, ByteWriter& out) {
  for (int i = 0; i < 3; ++i) out.put(static_cast<float>(point.position[i]));
  for (int i = 0; i < 3; ++i) out.put(point.normal[i]);
  out.put(point.intensity);
  for (int i = 0; i < 3; ++i) out.put(grey_of(point));
  out.put(static_cast<double>(point.stamp.ns) * 1e-9);
}

}  // namespace nilio::mapping
