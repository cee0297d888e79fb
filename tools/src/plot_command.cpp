#include "commands.hpp"
#include "metrics.hpp"
#include "plot_canvas.hpp"
#include "plot_figure.hpp"
#include "plot_map.hpp"
#include "trajectory.hpp"

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>

namespace nilio::tools {

namespace {

constexpr int kWidth = 1600;
constexpr int kHeight = 900;

enum class Plane { kAuto, kXy, kXz };

struct PlotArguments {
  std::vector<std::string> trajectory_paths;
  std::string truth_path;
  std::string map_path;
  std::string output_path;
  Alignment alignment = Alignment::kOrigin;
  Plane plane = Plane::kAuto;
};

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

std::string short_name(const std::string& path) { return std::filesystem::path(path).stem().string(); }

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
                                const PlotArguments& arguments, const TopView& view, PlotFigure& figure) {
  if (!truth) {
    figure.estimates.push_back({short_name(estimate.path), view.project(estimate.poses)});
    return Pose(Pose::Identity());
  }
  const auto pairs = associate(*truth, estimate, {});
  if (!pairs) return pairs.error();
  const std::vector<Pose> aligned = align(*pairs, arguments.alignment);
  const Pose transform = aligned.front() * pairs->estimate.front().inverse();
  const std::vector<double> distance = path_lengths(pairs->truth);
  std::vector<double> errors;
  PlotCurve curve{short_name(estimate.path), {}};
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

core::Result<PlotFigure> make_figure(const PlotArguments& arguments) {
  std::vector<Trajectory> estimates;
  for (const std::string& path : arguments.trajectory_paths) {
    auto estimate = read_trajectory(path);
    if (!estimate) return estimate.error();
    estimates.push_back(std::move(estimate).value());
  }
  std::optional<Trajectory> truth;
  if (!arguments.truth_path.empty()) {
    auto loaded = read_trajectory(arguments.truth_path);
    if (!loaded) return loaded.error();
    truth = std::move(loaded).value();
  }
  const bool camera = arguments.plane == Plane::kAuto ? is_camera_frame(truth ? *truth : estimates.front())
                                                      : arguments.plane == Plane::kXz;
  const TopView view(camera);
  PlotFigure figure{"x [m]", view.y_label(), std::nullopt, {}, {}, {}};
  if (truth) figure.truth = PlotCurve{"truth: " + short_name(truth->path), view.project(truth->poses)};
  std::optional<Pose> map_transform;
  for (const Trajectory& estimate : estimates) {
    const auto transform = add_estimate(estimate, truth, arguments, view, figure);
    if (!transform) return transform.error();
    if (!map_transform) map_transform = *transform;
  }
  if (arguments.map_path.empty()) return figure;
  auto map = read_map_points(arguments.map_path);
  if (!map) return map.error();
  for (Eigen::Vector3f& point : *map) {
    const Eigen::Vector3d moved = *map_transform * point.cast<double>();
    const Eigen::Vector2d seen = view.project(moved);
    point = Eigen::Vector3d(seen.x(), seen.y(), view.height(moved)).cast<float>();
  }
  figure.map = std::move(map).value();
  return figure;
}

int run_plot(const PlotArguments& arguments) {
  const auto fail = [](const core::Error& error) {
    std::cerr << "nilio plot: " << error.message << '\n';
    return 1;
  };
  const auto figure = make_figure(arguments);
  if (!figure) return fail(figure.error());
  auto canvas = Canvas::create(arguments.output_path, kWidth, kHeight);
  if (!canvas) return fail(canvas.error());
  draw_figure(*canvas, *figure);
  const auto saved = canvas->save();
  return saved ? 0 : fail(saved.error());
}

}  // namespace

void add_plot_command(CLI::App& app, int& status) {
  auto arguments = std::make_shared<PlotArguments>();
  CLI::App* command = app.add_subcommand("plot", "draw trajectories from above, their errors and a map");
  command->footer(
      "With --truth, estimates are moved onto it (--align) and their position errors are drawn too.\n"
      "The map is moved with the first trajectory.");
  command->add_option("trajectories", arguments->trajectory_paths, "TUM or KITTI files")->required();
  command->add_option("--truth", arguments->truth_path, "true trajectory, TUM or KITTI, drawn in grey");
  command->add_option("--map", arguments->map_path,
                      "map points as .ply (binary) or .xyz, coloured by height");
  command->add_option("-o,--output", arguments->output_path, "picture to write, .png or .svg")->required();
  command->add_option("--align", arguments->alignment, "with --truth: none, origin (default) or se3")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, Alignment>{
              {"none", Alignment::kNone}, {"origin", Alignment::kOrigin}, {"se3", Alignment::kSe3}},
          CLI::ignore_case));
  command
      ->add_option(
          "--plane", arguments->plane,
          "plane seen from above: xy, xz (camera frame) or auto (default: xz for KITTI camera poses)")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, Plane>{{"auto", Plane::kAuto}, {"xy", Plane::kXy}, {"xz", Plane::kXz}},
          CLI::ignore_case));
  command->callback([arguments, &status] { status = run_plot(*arguments); });
}

}  // namespace nilio::tools
