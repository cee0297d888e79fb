#pragma once

#include "tools/commands/commands.hpp"

#include <string>
#include <vector>

namespace nilio::tests {

using AddCommand = void (*)(CLI::App&, int&);

/// Exit status and outputs of a command.
struct CommandResult {
  int status = 0;
  std::string output;
  std::string errors;
};

/// Status of a rejected command line.
inline constexpr int kNotAccepted = -1;

/// Runs one of the program's commands as its main() does, and captures its output.
CommandResult capture_command(AddCommand add_command, std::vector<std::string> arguments);

/// The same for a line that is split as by a shell.
CommandResult capture_command(AddCommand add_command, const std::string& line);

/// Only the status of the command.
int run_command(AddCommand add_command, std::vector<std::string> arguments);

}  // namespace nilio::tests
