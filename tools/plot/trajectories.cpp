#include "tools/plot/trajectories.hpp"

#include <array>
#include <cstdio>
#include <utility>

namespace nilio::tools {

namespace {

/// KITTI poses are of a camera (z forward, y down) or of a LiDAR (x forward, z up): a vehicle moves along its
/// own axis.
bool is_camera_frame(const Trajectory& trajectory) {
  if (trajectory.format != TrajectoryFormat::kKitti) return false;
  Eigen::Vector3d along_axes = Eigen::Vector3d::Zero();
  for (std::size_t i = 1; i < trajectory.poses.size(); ++i) {
    along_axes += (trajectory.poses[i - 1].inverse() * trajectory.poses[i]).translation().cwiseAbs();
  }
  return along_axes.z() > along_axes.x();
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
  const Statistics statistics = compute_statistics(errors);
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(), "  (APE %.2f m, end %.2f m = %.2f %%)", statistics.rmse,
                errors.back(), length_m > 0.0 ? 100.0 * errors.back() / length_m : 0.0);
  return name + text.data();
}

/// Adds one estimate: moved onto the truth, with its error curve, or as it is without a truth. Returns the
/// transform that moved it.
core::Result<Pose> add_estimate(const Trajectory& estimate, const std::optional<Trajectory>& truth,
                                Alignment alignment, const TopView& view, PlotFigure& figure) {
  if (!truth) {
    figure.estimates.push_back({estimate.path, view.project(estimate.poses)});
    return Pose(Pose::Identity());
  }
  const auto pairs = associate(*truth, estimate, {});
  if (!pairs) return pairs.error();
  const std::vector<Pose> aligned = align(*pairs, alignment);
  const Pose transform = aligned.front() * pairs->estimate.front().inverse();
  const std::vector<double> distance = path_lengths(pairs->truth);
  std::vector<double> errors;
  PlotCurve curve{estimate.path, {}};
  for (std::size_t i = 0; i < aligned.size(); ++i) {
    errors.push_back((aligned[i].translation() - pairs->truth[i].translation()).norm());
    curve.points.emplace_back(distance[i], errors.back());
  }
  std::vector<Pose> moved;
  for (const Pose& pose : estimate.poses) moved.push_back(transform * pose);
  figure.estimates.push_back({name_with_errors(curve.name, errors, distance.back()), view.project(moved)});
  figure.errors.push_back(std::move(curve));
  return transform;
}

}  // namespace

core::Result<PlotFigure> trajectory_figure(const std::vector<Trajectory>& estimates,
                                           const std::optional<Trajectory>& truth,
                                           std::vector<Eigen::Vector3f> map,
                                           const TrajectoryFigureOptions& options) {
  const bool camera = options.plane == PlotPlane::kAuto ? is_camera_frame(truth ? *truth : estimates.front())
                                                        : options.plane == PlotPlane::kXz;
  const TopView view(camera);
  PlotFigure figure{"x [m]", view.y_label(), std::nullopt, {}, {}, {}};
  if (truth) figure.truth = PlotCurve{"truth: " + truth->path, view.project(truth->poses)};
  std::optional<Pose> map_transform;
  for (const Trajectory& estimate : estimates) {
    const auto transform = add_estimate(estimate, truth, options.alignment, view, figure);
    if (!transform) return transform.error();
    if (!map_transform) map_transform = *transform;
  }
  for (Eigen::Vector3f& point : map) {
    const Eigen::Vector3d moved = *map_transform * point.cast<double>();
    const Eigen::Vector2d seen = view.project(moved);
    point = Eigen::Vector3d(seen.x(), seen.y(), view.height(moved)).cast<float>();
  }
  figure.map = std::move(map);
  return figure;
}

}  // namespace nilio::tools
