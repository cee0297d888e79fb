#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"
#include "tools/common/progress.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/evaluate/metrics.hpp"
#include "tools/plot/figure.hpp"
#include "tools/plot/map.hpp"
#include "tools/plot/trajectories.hpp"

#include <filesystem>
#include <iostream>
#include <memory>

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
  evaluate::Alignment alignment = evaluate::Alignment::kOrigin;
  plot::Plane plane = plot::Plane::kAuto;
};

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
  if (const auto mixed = plot::find_mixed_frames(estimates, truth)) {
    if (arguments.plane == plot::Plane::kAuto)
      return core::Error{
          *mixed + ": they cannot share a picture - convert one kind, as 'nilio evaluate --calib' does, or " +
          "choose --plane"};
    std::cerr << "nilio plot: warning: " << *mixed << ": the picture does not compare them\n";
  }
  return plot::trajectory_figure(estimates, truth, std::move(map), {arguments.alignment, arguments.plane});
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
  command->add_option("--align", arguments->alignment, "with --truth: none, origin (default) or se3")
      ->transform(choice_of<evaluate::Alignment>({{"none", evaluate::Alignment::kNone},
                                                  {"origin", evaluate::Alignment::kOrigin},
                                                  {"se3", evaluate::Alignment::kSe3}}));
  command
      ->add_option(
          "--plane", arguments->plane,
          "plane seen from above: xy, xz (camera frame) or auto (default: xz for KITTI camera poses)")
      ->transform(choice_of<plot::Plane>(
          {{"auto", plot::Plane::kAuto}, {"xy", plot::Plane::kXy}, {"xz", plot::Plane::kXz}}));
  command->callback([arguments, &status] { status = run_plot(*arguments); });
}

}  // namespace nilio::tools
