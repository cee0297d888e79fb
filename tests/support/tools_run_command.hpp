#pragma once

#include "tools/commands/command_line_fwd.hpp"

#include <string>
#include <vector>

namespace nilio::tests {

using AddCommand = void (*)(CLI::App&, int&);

/// What a command left behind.
struct CommandResult {
  int status = 0;
  std::string output;
  std::string errors;
};

/// Status of a command line that is not accepted.
inline constexpr int kNotAccepted = -1;

/// Runs one of the program's commands as its main() does, and keeps what it says.
CommandResult hear_command(AddCommand add_command, std::vector<std::string> arguments);

/// The same for a line whose words are split as a shell does.
CommandResult hear_command(AddCommand add_command, const std::string& line);

/// The command's status alone.
int run_command(AddCommand add_command, std::vector<std::string> arguments);

}  // namespace nilio::tests
