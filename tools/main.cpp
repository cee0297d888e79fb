#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"

#include <memory>
#include <string>

#include <CLI/CLI.hpp>

namespace {

/// Appends the exit statuses to the help of every command.
void explain_exit_status(CLI::App& app) {
  for (CLI::App* const command : app.get_subcommands(nullptr)) {
    const std::string footer = command->get_footer();
    command->footer(footer + (footer.empty() ? "" : "\n\n") +
                    nilio::exit_status_help("nilio " + command->get_name()));
  }
  app.footer(nilio::exit_status_help("nilio"));
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "nilio: set up, record, play, inspect, simulate, convert, evaluate, plot and watch LiDAR-inertial "
      "odometry"};
  app.formatter(std::make_shared<nilio::HelpFormatter>());
  app.require_subcommand(1);
  app.set_version_flag("--version", NILIO_VERSION);
  int status = 0;
  nilio::tools::add_init_command(app, status);
  nilio::tools::add_record_command(app, status);
  nilio::tools::add_play_command(app, status);
  nilio::tools::add_simulate_command(app, status);
  nilio::tools::add_mangle_command(app, status);
  nilio::tools::add_convert_command(app, status);
  nilio::tools::add_evaluate_command(app, status);
  nilio::tools::add_report_command(app, status);
  nilio::tools::add_inspect_command(app, status);
  nilio::tools::add_map_command(app, status);
  nilio::tools::add_plot_command(app, status);
  nilio::tools::add_watch_command(app, status);
  nilio::tools::add_view_command(app, status);
  nilio::tools::add_bench_command(app);
  nilio::tools::add_reference_command(app, status);
  explain_exit_status(app);
  return nilio::parse_command_line(app, argc, argv).value_or(status);
}
