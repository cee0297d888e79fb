#include "tools/commands/command_line.hpp"

#include "tools/commands/commands.hpp"

#include <memory>
#include <sstream>
#include <string>

#include <catch2/catch.hpp>

using namespace nilio::tools;

namespace {

void check_width(CLI::App& command) {
  CAPTURE(command.get_name());
  std::istringstream help(command.help());
  for (std::string line; std::getline(help, line);) {
    CAPTURE(line);
    CHECK(line.size() <= nilio::HelpFormatter::kColumns);
  }
  for (CLI::App* subcommand : command.get_subcommands({})) check_width(*subcommand);
}

}  // namespace

TEST_CASE("help texts of all commands are at most 100 columns wide", "[command_line]") {
  CLI::App app;
  app.formatter(std::make_shared<nilio::HelpFormatter>());
  int status = 0;
  for (const auto add : {add_record_command, add_play_command, add_simulate_command, add_convert_command,
                         add_evaluate_command, add_inspect_command, add_plot_command, add_watch_command})
    add(app, status);
  add_bench_command(app);
  check_width(app);
}
