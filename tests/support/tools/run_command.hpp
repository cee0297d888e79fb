#pragma once

#include "tools/commands/commands.hpp"

#include <array>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

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

/// The same of a measurement of nilio bench.
inline int run_bench(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "bench");
  return run_command([](CLI::App& app, int&) { tools::add_bench_command(app); }, std::move(arguments));
}

/// Standard output of a program, and whether it succeeded.
inline std::pair<std::string, bool> run_program(const std::string& command) {
  std::string output;
  FILE* pipe = popen(command.c_str(), "r");
  REQUIRE(pipe != nullptr);
  std::array<char, 4096> buffer{};
  while (const std::size_t n = std::fread(buffer.data(), 1, buffer.size(), pipe))
    output.append(buffer.data(), n);
  return {output, pclose(pipe) == 0};
}

}  // namespace nilio::tests
