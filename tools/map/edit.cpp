#include "tools/map/edit.hpp"

#include "nilio/core/clock.hpp"

#include "tools/common/trajectory.hpp"
#include "tools/map/gnss.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <unordered_map>
#include <utility>

namespace nilio::tools::map {

namespace {

using core::Error;
using core::Result;
using core::Vector3;
using mapping::MapReader;
using mapping::MapWriter;
using mapping::Submap;
using mapping::SubmapEntry;

core::Time now() { return {clock_ns(CLOCK_REALTIME)}; }

/// A new map; fails if the folder holds one.
Result<MapWriter> create_map(const std::filesystem::path& folder) {
  if (std::filesystem::exists(folder / "map.log"))
    return Error{folder.string() + ": holds a map already - choose another folder"};
  return MapWriter::open(folder, "nilio map", now());
}

/// Writes the datum of a map that has the same frame.
Result<std::monostate> write_datum(const std::optional<mapping::MapGnss>& gnss, MapWriter& writer) {
  if (!gnss) return std::monostate{};
  return writer.write(
      mapping::MapCorrection{{}, {}, mapping::MapGnss{gnss->datum, gnss->altitude, gnss->datum, {}}});
}

/// Whether the frames lie within 1 m and 0.5 deg of each other.
bool is_same_place(const mapping::Datum& a, const mapping::Datum& b) {
  const Vector3 offset =
      gnss::GeodeticFrame(origin_of(a)).local(b.latitude_deg, b.longitude_deg, b.altitude_m);
  const double turn = std::remainder(a.heading_deg - b.heading_deg, 360.0);
  return offset.norm() < 1.0 && std::abs(turn) < 0.5;
}

/// Cells of a hash grid in the map frame.
class PointGrid {
 public:
  explicit PointGrid(double cell_m) : cell_m_(cell_m) {}
  void add(const Vector3& point, std::size_t index) { cells_[key_of(cell_at(point))].push_back(index); }

  /// Calls visit(index) for the points in the cells around a point.
  template <class Visit>
  void visit_near(const Vector3& point, const Visit& visit) const {
    const Eigen::Vector3i centre = cell_at(point);
    for (int i = 0; i < 27; ++i) {
      const Eigen::Vector3i cell = centre + Eigen::Vector3i(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1);
      const auto found = cells_.find(key_of(cell));
      if (found == cells_.end()) continue;
      for (const std::size_t index : found->second) visit(index);
    }
  }

 private:
  [[nodiscard]] Eigen::Vector3i cell_at(const Vector3& point) const {
    return (point / cell_m_).array().floor().cast<int>();
  }
  static std::uint64_t key_of(const Eigen::Vector3i& cell) {
    constexpr std::uint64_t mask = (1U << 21U) - 1;
    return (static_cast<std::uint64_t>(cell.x()) & mask) << 42U |
           (static_cast<std::uint64_t>(cell.y()) & mask) << 21U |
           (static_cast<std::uint64_t>(cell.z()) & mask);
  }

  double cell_m_;
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> cells_;
};

/// Places near a path.
class Neighbourhood {
 public:
  Neighbourhood(const Trajectory& path, double reach_m) : path_(path), reach_m_(reach_m), grid_(reach_m) {
    for (std::size_t i = 0; i < path.poses.size(); ++i) grid_.add(path.poses[i].translation(), i);
  }
  [[nodiscard]] bool contains(const Vector3& point) const {
    bool is_near = false;
    grid_.visit_near(point, [&](std::size_t i) {
      is_near = is_near || (path_.poses[i].translation() - point).norm() <= reach_m_;
    });
    return is_near;
  }

 private:
  const Trajectory& path_;
  double reach_m_;
  PointGrid grid_;
};

/// Compares the surfaces of `from` with those of `to`.
void compare(const std::vector<CloudPoint>& from, const std::vector<CloudPoint>& to,
             const Neighbourhood& seen, float mark, std::size_t& both, std::size_t& only, double& square_sum,
             MapDifference& difference) {
  constexpr double kNearMetres = mapping::kIrregularVoxelMetres;
  PointGrid grid(kNearMetres);
  for (std::size_t i = 0; i < to.size(); ++i) grid.add(to[i].position, i);
  for (const CloudPoint& point : from) {
    if (!seen.contains(point.position)) continue;
    double nearest = kNearMetres;
    double along_normal = 0.0;
    bool found = false;
    grid.visit_near(point.position, [&](std::size_t i) {
      const Vector3 d = to[i].position - point.position;
      if (d.norm() >= nearest) return;
      nearest = d.norm();
      along_normal = d.dot(to[i].normal.cast<double>());
      found = true;
    });
    if (found) {
      ++both;
      square_sum += along_normal * along_normal;
      continue;
    }
    ++only;
    difference.changes.push_back(point);
    difference.changes.back().intensity = mark;
  }
}

}  // namespace

Result<MapSummary> summarise(const MapReader& map) {
  MapSummary summary;
  const auto path = read_path(map);
  if (!path) return path.error();
  summary.submaps = map.submaps().size();
  summary.keyframes = path->poses.size();
  summary.bounds.minimum.setConstant(std::numeric_limits<double>::infinity());
  summary.bounds.maximum = -summary.bounds.minimum;
  summary.path_m = path_length(path->poses);
  if (!path->stamps.empty()) {
    summary.first = path->stamps.front();
    summary.last = path->stamps.back();
  }
  for (const SubmapEntry& entry : map.submaps()) {
    summary.surfaces += entry.surfaces;
    summary.megabytes += static_cast<double>(entry.file_bytes) * 1e-6;
    for (int corner = 0; corner < 8 && entry.surfaces > 0; ++corner) {
      Vector3 p;
      for (int axis = 0; axis < 3; ++axis)
        p[axis] = static_cast<double>((corner >> axis & 1) != 0 ? entry.maximum[axis] : entry.minimum[axis]);
      p = entry.T_map_submap * p;
      summary.bounds.minimum = summary.bounds.minimum.cwiseMin(p);
      summary.bounds.maximum = summary.bounds.maximum.cwiseMax(p);
    }
  }
  return summary;
}

Result<std::monostate> crop(const MapReader& map, const Box& box, const std::filesystem::path& output) {
  auto writer = create_map(output);
  if (!writer) return writer.error();
  std::size_t kept = 0;
  for (const SubmapEntry& entry : map.submaps()) {
    auto submap = map.load(entry);
    if (!submap) return submap.error();
    submap->T_odom_submap = entry.T_map_submap;
    std::erase_if(submap->surfaces, [&](const mapping::Surface& surface) {
      return !box.contains(entry.T_map_submap * surface.mean.cast<double>());
    });
    if (submap->surfaces.empty()) continue;
    submap->id = static_cast<std::uint32_t>(kept++);
    if (auto written = writer->write(*submap, now()); !written) return written;
  }
  if (kept == 0)
    return Error{output.string() + ": no surface of the map lies in the box - check --min and --max"};
  return write_datum(map.gnss(), *writer);
}

Result<std::monostate> merge(const std::vector<MapReader>& maps, const std::filesystem::path& output) {
  std::optional<mapping::MapGnss> gnss;
  for (const MapReader& map : maps) {
    if (gnss && map.gnss() && !is_same_place(gnss->datum, map.gnss()->datum))
      return Error{output.string() +
                   ": the maps have different places by GNSS - merge maps of one frame only, such as parts "
                   "of one map"};
    if (!gnss) gnss = map.gnss();
  }
  auto writer = create_map(output);
  if (!writer) return writer.error();
  std::uint32_t id = 0;
  for (const MapReader& map : maps) {
    for (const SubmapEntry& entry : map.submaps()) {
      auto submap = map.load(entry);
      if (!submap) return submap.error();
      submap->id = id++;
      submap->T_odom_submap = entry.T_map_submap;
      if (auto written = writer->write(*submap, now()); !written) return written;
    }
  }
  return write_datum(gnss, *writer);
}

Result<MapDifference> diff(const MapReader& first, const MapReader& second, double reach_m) {
  const auto first_path = read_path(first);
  if (!first_path) return first_path.error();
  const auto second_path = read_path(second);
  if (!second_path) return second_path.error();
  const auto first_cloud = read_cloud(first);
  if (!first_cloud) return first_cloud.error();
  const auto second_cloud = read_cloud(second);
  if (!second_cloud) return second_cloud.error();
  MapDifference difference;
  double square_sum = 0.0;
  double unused_sum = 0.0;
  std::size_t unused = 0;
  compare(*first_cloud, *second_cloud, Neighbourhood(*second_path, reach_m), 0.0F, difference.both,
          difference.only_first, square_sum, difference);
  compare(*second_cloud, *first_cloud, Neighbourhood(*first_path, reach_m), 255.0F, unused,
          difference.only_second, unused_sum, difference);
  if (difference.both > 0)
    difference.distance_rms_m = std::sqrt(square_sum / static_cast<double>(difference.both));
  return difference;
}

}  // namespace nilio::tools::map
