#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"

#include <memory>

#include <CLI/CLI.hpp>

int main(int argc, char** argv) {
  CLI::App app{
      "nilio: record, play, inspect, simulate, convert, evaluate, plot and watch LiDAR-inertial odometry"};
  app.formatter(std::make_shared<nilio::HelpFormatter>());
  app.require_subcommand(1);
  app.footer(
      "Exit status: 0 done; 1 failed, with one message; 2 wrong usage; 3 done, but the result is bad.");
  app.set_version_flag("--version", NILIO_VERSION);
  int status = 0;
  nilio::tools::add_record_command(app, status);
  nilio::tools::add_play_command(app, status);
  nilio::tools::add_simulate_command(app, status);
  nilio::tools::add_convert_command(app, status);
  nilio::tools::add_evaluate_command(app, status);
  nilio::tools::add_inspect_command(app, status);
  nilio::tools::add_plot_command(app, status);
  nilio::tools::add_watch_command(app, status);
  nilio::tools::add_bench_command(app);
  return nilio::parse_command_line(app, argc, argv).value_or(status);
}
