#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"
#include "tools/common/progress.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/evaluate/metrics.hpp"
#include "tools/plot/figure.hpp"
#include "tools/plot/map.hpp"
#include "tools/plot/trajectories.hpp"

#include <charconv>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <memory>
#include <string_view>
#include <system_error>

#include <CLI/CLI.hpp>

namespace nilio::tools {

namespace {

constexpr int kWidth = 1600;
constexpr int kHeight = 900;

struct PlotArguments {
  std::vector<std::string> trajectory_paths;
  std::string truth_path;
  std::string map_path;
  std::string output_path;
  plot::TrajectoryFigureOptions figure;
  std::string relative_step = "1";
};

/// "10m" or a number of poses.
core::Result<evaluate::RelativeStep> parse_step(const std::string& text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const std::string_view unit(end, static_cast<std::size_t>(text.data() + text.size() - end));
  const bool is_good = error == std::errc() && value > 0.0 && value <= 1e6;
  if (is_good && unit == "m") return evaluate::RelativeStep{1, value};
  if (is_good && unit.empty() && value == std::floor(value))
    return evaluate::RelativeStep{static_cast<std::size_t>(value), std::nullopt};
  return core::Error{"--rpe-step " + text + ": is neither a number of poses nor a length - give 1, or 10m"};
}

core::Result<plot::Figure> make_figure(const PlotArguments& arguments, Progress& progress) {
  std::vector<Trajectory> estimates;
  for (const std::string& path : arguments.trajectory_paths) {
    auto estimate = read_trajectory(path);
    if (!estimate) return estimate.error();
    estimate->path = std::filesystem::path(path).stem().string();
    estimates.push_back(std::move(estimate).value());
    progress.update(estimates.size());
  }
  std::optional<Trajectory> truth;
  if (!arguments.truth_path.empty()) {
    auto loaded = read_trajectory(arguments.truth_path);
    if (!loaded) return loaded.error();
    truth = std::move(loaded).value();
    truth->path = std::filesystem::path(arguments.truth_path).stem().string();
  }
  std::vector<Eigen::Vector3f> map;
  if (!arguments.map_path.empty()) {
    auto points = plot::read_map_points(arguments.map_path);
    if (!points) return points.error();
    map = std::move(points).value();
  }
  progress.update(estimates.size() + 1);
  if (const auto mixed = plot::find_mixed_frames(estimates, truth, !map.empty())) {
    if (arguments.figure.plane == plot::Plane::kAuto)
      return core::Error{
          *mixed + ": they cannot share a picture - convert one kind, as 'nilio evaluate --calib' does, or " +
          "choose --plane"};
    std::cerr << "nilio plot: warning: " << *mixed << ": the picture does not compare them\n";
  }
  const auto step = parse_step(arguments.relative_step);
  if (!step) return step.error();
  plot::TrajectoryFigureOptions options = arguments.figure;
  options.relative_step = *step;
  return plot::trajectory_figure(estimates, truth, std::move(map), options);
}

int run_plot(const PlotArguments& arguments) {
  const auto fail = [](const core::Error& error) {
    std::cerr << "nilio plot: " << error.message << '\n';
    return 1;
  };
  // Files, alignment, drawing.
  const std::size_t steps = arguments.trajectory_paths.size() + 3;
  Progress progress("plot", steps);
  const auto figure = make_figure(arguments, progress);
  if (!figure) return fail(figure.error());
  progress.update(steps - 1);
  const auto saved = plot::save_figure(*figure, arguments.output_path, kWidth, kHeight);
  if (saved) progress.update(steps);
  return saved ? 0 : fail(saved.error());
}

}  // namespace

void add_plot_command(CLI::App& app, int& status) {
  auto arguments = std::make_shared<PlotArguments>();
  CLI::App* command =
      app.add_subcommand("plot", "draw up to eight trajectories from above, their errors and a map");
  command->footer(
      "With --truth, estimates are aligned to it (--align) and their position errors are drawn too.\n"
      "The map moves with the first trajectory. Camera poses and vehicle poses are refused together.");
  command->add_option("trajectories", arguments->trajectory_paths, "TUM or KITTI files")->required();
  command->add_option("--truth", arguments->truth_path, "true trajectory, TUM or KITTI, drawn in grey");
  command->add_option("--map", arguments->map_path,
                      "map points as .ply (binary) or .xyz, coloured by height");
  command->add_option("-o,--output", arguments->output_path, "picture to write, .png or .svg")->required();
  command->add_option("--align", arguments->figure.alignment, "with --truth: none, origin (default) or se3")
      ->transform(choice_of<evaluate::Alignment>({{"none", evaluate::Alignment::kNone},
                                                  {"origin", evaluate::Alignment::kOrigin},
                                                  {"se3", evaluate::Alignment::kSe3}}));
  command
      ->add_option(
          "--plane", arguments->figure.plane,
          "plane seen from above: xy, xz (camera frame) or auto (default: xz for KITTI camera poses)")
      ->transform(choice_of<plot::Plane>(
          {{"auto", plot::Plane::kAuto}, {"xy", plot::Plane::kXy}, {"xz", plot::Plane::kXz}}));
  using Kind = plot::PanelKind;
  command
      ->add_option(
          "--panels", arguments->figure.panels,
          "panels, separated by commas: top, error, ape, rotation, rpe, xyz, rpy, histogram (default: top, "
          "and error with --truth)")
      ->delimiter(',')
      ->transform(choice_of<Kind>({{"top", Kind::kTop},
                                   {"error", Kind::kError},
                                   {"ape", Kind::kApe},
                                   {"rotation", Kind::kRotation},
                                   {"rpe", Kind::kRpe},
                                   {"xyz", Kind::kXyz},
                                   {"rpy", Kind::kRpy},
                                   {"histogram", Kind::kHistogram}}));
  command
      ->add_option("--rpe-step", arguments->relative_step,
                   "distance of the two poses of a relative error: poses, or metres as in 10m")
      ->capture_default_str();
  command->add_flag("--colour-by-error", arguments->figure.colour_by_error,
                    "colour the trajectories of the top view by their position error");
  command->add_option("--title", arguments->figure.title, "title of the picture");
  command->callback([arguments, &status] { status = run_plot(*arguments); });
}

}  // namespace nilio::tools
