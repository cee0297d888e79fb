#pragma once

#include "temporary_folder.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <catch2/catch.hpp>

namespace nilio::tests {

/// Runs one of the program's commands as its main() does, silently; -1 when the command line is not accepted.
inline int run_command(void (*add_command)(CLI::App&, int&), std::vector<std::string> arguments) {
  CLI::App app;
  int status = 0;
  add_command(app, status);
  std::reverse(arguments.begin(), arguments.end());
  const std::ostringstream ignored;
  std::streambuf* const output = std::cout.rdbuf(ignored.rdbuf());
  std::streambuf* const errors = std::cerr.rdbuf(ignored.rdbuf());
  try {
    app.parse(arguments);
  } catch (const CLI::ParseError&) {
    status = -1;
  }
  std::cout.rdbuf(output);
  std::cerr.rdbuf(errors);
  return status;
}

inline std::string read_text(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
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
