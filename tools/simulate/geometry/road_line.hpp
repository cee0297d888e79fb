#pragma once

#include "tools/simulate/geometry/mesh.hpp"
#include "tools/simulate/geometry/route.hpp"
#include "tools/simulate/scenes/traffic.hpp"

#include <functional>
#include <vector>

namespace nilio::tools::simulate {

/// Centre line of the driven lane and its heights; other objects are placed relative to it.
struct RoadLine {
  Route route;
  std::vector<double> heights;

  [[nodiscard]] double length_m() const { return route.arc_length.back(); }
  /// Height and slope of the lane, without bank.
  [[nodiscard]] GroundSlope ground(double at_m) const;
  /// Point in world at a distance along the lane, to its left and above it.
  [[nodiscard]] core::Vector3 place(double at_m, double left_m, double up_m) const;
  /// Upright frame at that point, x along the lane turned by `yaw_rad`.
  [[nodiscard]] core::SE3 frame(double at_m, double left_m, double up_m, double yaw_rad = 0.0) const;
  /// Path of a vehicle beside the lane, points a metre apart; against the lane's direction if `oncoming`.
  [[nodiscard]] std::vector<core::Vector3> path(double left_m, bool oncoming) const;
};

using AlongLine = std::function<double(double)>;
/// A lane whose heading (rad) and height (m) follow functions of the distance travelled.
RoadLine make_road_line(double length_m, const AlongLine& heading, const AlongLine& height);

/// A cross-section: left and up of the lane, metres.
using Profile = std::vector<Vector2>;

/// Begin and end of a strip, and the spacing of its cross-sections.
struct Stretch {
  double from_m = 0.0;
  double to_m = 0.0;
  double step_m = 5.0;
};

/// Extrudes a cross-section along a stretch of the lane.
void add_strip(TriangleMesh& mesh, const RoadLine& line, const Stretch& stretch, const Profile& profile,
               Material material);
/// The same with a cross-section that varies along the lane; its number of points is constant.
void add_strip(TriangleMesh& mesh, const RoadLine& line, const Stretch& stretch,
               const std::function<Profile(double)>& profile_at, Material material);
/// Guard rail on posts; it stands at the height of the lane.
void add_guard_rail(TriangleMesh& mesh, const RoadLine& line, const Stretch& stretch, double left_m);

/// Travelled distance at every control instant, at a speed that varies by 1 %.
std::vector<double> travel_at(double start_m, double speed_m_s, double duration_s);

/// Ground as triangles of `cell_m` within `reach_m` of a path.
struct HeightField {
  double cell_m = 1.0;
  double reach_m = 50.0;
  std::function<double(const Vector2&)> height;
  std::function<Material(const Vector2&)> material;
};
void add_height_field(TriangleMesh& mesh, const std::vector<Vector2>& path, const HeightField& field);

}  // namespace nilio::tools::simulate
