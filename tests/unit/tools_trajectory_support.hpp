#pragma once

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <catch2/catch.hpp>

namespace nilio::tests {

/// A folder that is gone after the test.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "nilio_tools_XXXXXX").string();
    REQUIRE(mkdtemp(pattern.data()) != nullptr);
    path_ = pattern;
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }

  [[nodiscard]] std::string file(const std::string& name) const { return (path_ / name).string(); }
  [[nodiscard]] std::string write(const std::string& name, const std::string& content) const {
    std::filesystem::create_directories((path_ / name).parent_path());
    std::ofstream(path_ / name, std::ios::binary) << content;
    return file(name);
  }

 private:
  std::filesystem::path path_;
};

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
