#include "tools/plot/trajectories.hpp"

#include <array>
#include <cstdio>
#include <utility>

namespace nilio::tools::plot {

namespace {

/// Path travelled along each body axis, metres.
Eigen::Vector3d travel_along_body_axes(const Trajectory& trajectory) {
  Eigen::Vector3d travel = Eigen::Vector3d::Zero();
  for (std::size_t i = 1; i < trajectory.poses.size(); ++i)
    travel += (trajectory.poses[i - 1].inverse() * trajectory.poses[i]).translation().cwiseAbs();
  return travel;
}

/// KITTI poses belong to a camera (z forward, y down) or to a LiDAR (x forward, z up).
bool has_camera_poses(const Trajectory& trajectory) {
  const Eigen::Vector3d travel = travel_along_body_axes(trajectory);
  return trajectory.format == TrajectoryFormat::kKitti && travel.z() > travel.x();
}

class TopView {
 public:
  explicit TopView(bool camera) : camera_(camera) {}
  [[nodiscard]] Eigen::Vector2d project(const Eigen::Vector3d& p) const {
    return camera_ ? Eigen::Vector2d(p.x(), p.z()) : Eigen::Vector2d(p.x(), p.y());
  }
  [[nodiscard]] double height(const Eigen::Vector3d& p) const { return camera_ ? -p.y() : p.z(); }
  [[nodiscard]] std::vector<Eigen::Vector2d> project(const std::vector<Pose>& poses) const {
    std::vector<Eigen::Vector2d> points;
    points.reserve(poses.size());
    for (const Pose& pose : poses) points.push_back(project(Eigen::Vector3d(pose.translation())));
    return points;
  }
  [[nodiscard]] const char* y_label() const { return camera_ ? "z [m]" : "y [m]"; }

 private:
  bool camera_;
};

std::string name_with_errors(const std::string& name, const std::vector<double>& errors, double length_m) {
  const evaluate::Statistics statistics = evaluate::compute_statistics(errors);
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(), "  (APE %.2f m, end %.2f m = %.2f %%)", statistics.rmse,
                errors.back(), length_m > 0.0 ? 100.0 * errors.back() / length_m : 0.0);
  return name + text.data();
}

/// Adds one estimate, aligned to the truth and with its error curve where there is one. Returns the
/// transform of the alignment.
core::Result<Pose> add_estimate(const Trajectory& estimate, const std::optional<Trajectory>& truth,
                                evaluate::Alignment alignment, const TopView& view, Panel& top,
                                std::vector<Curve>& error_curves) {
  if (!truth) {
    top.curves.push_back({estimate.path, view.project(estimate.poses)});
    return Pose(Pose::Identity());
  }
  const auto pairs = evaluate::associate(*truth, estimate, {});
  if (!pairs) return pairs.error();
  const std::vector<Pose> aligned = evaluate::align(*pairs, alignment);
  const Pose transform = aligned.front() * pairs->estimate.front().inverse();
  const std::vector<double> distance = path_lengths(pairs->truth);
  std::vector<double> errors;
  Curve curve{estimate.path, {}};
  for (std::size_t i = 0; i < aligned.size(); ++i) {
    errors.push_back((aligned[i].translation() - pairs->truth[i].translation()).norm());
    curve.points.emplace_back(distance[i], errors.back());
  }
  std::vector<Pose> moved;
  for (const Pose& pose : estimate.poses) moved.push_back(transform * pose);
  top.curves.push_back({name_with_errors(curve.name, errors, distance.back()), view.project(moved)});
  error_curves.push_back(std::move(curve));
  return transform;
}

}  // namespace

core::Result<Figure> trajectory_figure(const std::vector<Trajectory>& estimates,
                                       const std::optional<Trajectory>& truth,
                                       std::vector<Eigen::Vector3f> map,
                                       const TrajectoryFigureOptions& options) {
  const bool camera = options.plane == Plane::kAuto ? has_camera_poses(truth ? *truth : estimates.front())
                                                    : options.plane == Plane::kXz;
  const TopView view(camera);
  Panel top;
  top.x.label = "x [m]";
  top.y.label = view.y_label();
  top.is_top_view = true;
  Panel errors;
  errors.x.label = "distance travelled [m]";
  errors.y = {"position error [m]", false, true};
  if (truth) top.reference = Curve{"truth: " + truth->path, view.project(truth->poses)};
  std::optional<Pose> map_transform;
  for (const Trajectory& estimate : estimates) {
    const auto transform = add_estimate(estimate, truth, options.alignment, view, top, errors.curves);
    if (!transform) return transform.error();
    if (!map_transform) map_transform = *transform;
  }
  for (Eigen::Vector3f& point : map) {
    const Eigen::Vector3d moved = *map_transform * point.cast<double>();
    const Eigen::Vector2d seen = view.project(moved);
    point = Eigen::Vector3d(seen.x(), seen.y(), view.height(moved)).cast<float>();
  }
  top.map = std::move(map);
  Figure figure{{std::move(top)}};
  if (!errors.curves.empty()) figure.panels.push_back(std::move(errors));
  return figure;
}

std::optional<std::string> find_mixed_frames(const std::vector<Trajectory>& estimates,
                                             const std::optional<Trajectory>& truth) {
  constexpr double clear_ratio = 2.0;
  constexpr double shortest_m = 1.0;
  std::string cameras;
  std::string vehicles;
  const auto classify = [&](const Trajectory& trajectory) {
    const Eigen::Vector3d travel = travel_along_body_axes(trajectory);
    if (travel.norm() < shortest_m) return;
    if (travel.z() > clear_ratio * travel.x()) cameras = trajectory.path;
    if (travel.x() > clear_ratio * travel.z()) vehicles = trajectory.path;
  };
  if (truth) classify(*truth);
  for (const Trajectory& estimate : estimates) classify(estimate);
  if (cameras.empty() || vehicles.empty()) return std::nullopt;
  return cameras + " has camera poses (z forward), " + vehicles + " has vehicle or LiDAR poses (x forward)";
}

}  // namespace nilio::tools::plot
