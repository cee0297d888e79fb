#include "tools/simulate/geometry/road_line.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <unordered_map>
#include <utility>

namespace nilio::tools::simulate {

using core::SE3;
using core::Vector3;

GroundSlope RoadLine::ground(double at_m) const {
  const auto upper = std::upper_bound(route.arc_length.begin() + 1, route.arc_length.end() - 1, at_m);
  const auto b = static_cast<std::size_t>(upper - route.arc_length.begin());
  const double span = route.arc_length[b] - route.arc_length[b - 1];
  const double slope = (heights[b] - heights[b - 1]) / span;
  const Vector2 along = (route.points[b] - route.points[b - 1]) / span;
  return {heights[b - 1] + slope * (at_m - route.arc_length[b - 1]), slope * along};
}

Vector3 RoadLine::place(double at_m, double left_m, double up_m) const {
  const RoutePoint at = route_at(route, at_m);
  const Vector2 beside = at.position + left_m * left_of(direction(at.heading));
  return {beside.x(), beside.y(), ground(at_m).height + up_m};
}

SE3 RoadLine::frame(double at_m, double left_m, double up_m, double yaw_rad) const {
  return upright_frame(place(at_m, left_m, up_m), route_at(route, at_m).heading + yaw_rad);
}

std::vector<Vector3> RoadLine::path(double left_m, bool oncoming) const {
  std::vector<Vector3> places;
  for (double at = 0.0; at < length_m(); at += 1.0) places.push_back(place(at, left_m, 0.0));
  if (oncoming) std::reverse(places.begin(), places.end());
  return places;
}

RoadLine make_road_line(double length_m, const AlongLine& heading, const AlongLine& height) {
  std::vector<Vector2> points{Vector2::Zero()};
  std::vector<double> heights{height(0.0)};
  for (double at = kRouteStepM; at < length_m; at += kRouteStepM) {
    points.emplace_back(points.back() + kRouteStepM * direction(heading(at)));
    heights.push_back(height(at));
  }
  return {make_route(std::move(points)), smooth(std::move(heights), 10, 2)};
}

void add_strip(TriangleMesh& mesh, const RoadLine& line, const Stretch& stretch, const Profile& profile,
               Material material) {
  add_strip(
      mesh, line, stretch, [&](double) { return profile; }, material);
}

void add_strip(TriangleMesh& mesh, const RoadLine& line, const Stretch& stretch,
               const std::function<Profile(double)>& profile_at, Material material) {
  const double length = stretch.to_m - stretch.from_m;
  const auto steps = static_cast<std::size_t>(std::max(1.0, std::ceil(length / stretch.step_m)));
  std::vector<std::uint32_t> before;
  for (std::size_t i = 0; i <= steps; ++i) {
    const double at = stretch.from_m + length * static_cast<double>(i) / static_cast<double>(steps);
    std::vector<std::uint32_t> here;
    for (const Vector2& corner : profile_at(at))
      here.push_back(mesh.add_vertex(line.place(at, corner.x(), corner.y())));
    for (std::size_t k = 0; i > 0 && k + 1 < here.size(); ++k) {
      mesh.triangles.push_back({before[k], before[k + 1], here[k + 1]});
      mesh.triangles.push_back({before[k], here[k + 1], here[k]});
      mesh.materials.insert(mesh.materials.end(), 2, material);
    }
    before = std::move(here);
  }
}

void add_guard_rail(TriangleMesh& mesh, const RoadLine& line, const Stretch& stretch, double left_m) {
  const Profile beam{
      {left_m, 0.45}, {left_m + 0.05, 0.52}, {left_m, 0.6}, {left_m + 0.05, 0.68}, {left_m, 0.76}};
  add_strip(mesh, line, stretch, beam, Material::kMetal);
  for (double at = stretch.from_m; at < stretch.to_m; at += 4.0) {
    mesh.add_box(line.frame(at, left_m - 0.1, 0.0), {-0.06, -0.05, -0.3}, {0.06, 0.05, 0.7},
                 Material::kMetal);
  }
}

std::vector<double> travel_at(double start_m, double speed_m_s, double duration_s) {
  constexpr double kUnsteadiness = 0.01;
  constexpr double kPeriodS = 17.0;
  const double number = 2.0 * std::numbers::pi / kPeriodS;
  std::vector<double> travelled;
  for (double t = 0.0; t <= duration_s + 0.5 * kControlIntervalS; t += kControlIntervalS) {
    const double ahead_s = kUnsteadiness * (1.0 - std::cos(number * t)) / number;
    travelled.push_back(start_m + speed_m_s * (t + ahead_s));
  }
  return travelled;
}

void add_height_field(TriangleMesh& mesh, const std::vector<Vector2>& path, const HeightField& field) {
  using Cell = std::array<std::int64_t, 2>;
  const auto key_of = [](const Cell& c) { return c[0] * 4'000'037 + c[1]; };
  std::vector<Cell> cells;
  std::unordered_map<std::int64_t, bool> wanted;
  const auto reach = static_cast<std::int64_t>(field.reach_m / field.cell_m);
  const auto every = static_cast<std::size_t>(std::max(1.0, 0.1 * field.reach_m / kRouteStepM));
  for (std::size_t i = 0; i < path.size(); i += every) {
    const Cell middle{std::llround(path[i].x() / field.cell_m), std::llround(path[i].y() / field.cell_m)};
    for (std::int64_t dx = -reach; dx <= reach; ++dx) {
      for (std::int64_t dy = -reach; dy <= reach; ++dy) {
        const Cell cell{middle[0] + dx, middle[1] + dy};
        if (dx * dx + dy * dy <= reach * reach && wanted.try_emplace(key_of(cell), true).second)
          cells.push_back(cell);
      }
    }
  }
  std::unordered_map<std::int64_t, std::uint32_t> vertices;
  const auto vertex = [&](std::int64_t x, std::int64_t y) {
    const auto [found, added] = vertices.try_emplace(key_of({x, y}), 0U);
    if (added) {
      const Vector2 p = field.cell_m * Vector2(static_cast<double>(x), static_cast<double>(y));
      found->second = mesh.add_vertex({p.x(), p.y(), field.height(p)});
    }
    return found->second;
  };
  for (const auto& [x, y] : cells) {
    mesh.triangles.push_back({vertex(x, y), vertex(x + 1, y), vertex(x + 1, y + 1)});
    mesh.triangles.push_back({vertex(x, y), vertex(x + 1, y + 1), vertex(x, y + 1)});
    const Vector2 centre = field.cell_m * Vector2(static_cast<double>(x) + 0.5, static_cast<double>(y) + 0.5);
    mesh.materials.insert(mesh.materials.end(), 2, field.material(centre));
  }
}

}  // namespace nilio::tools::simulate
