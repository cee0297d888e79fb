#include "daemon/exit_status.hpp"

#include "tests/support/paths.hpp"
#include "tests/support/tools/record_support.hpp"

#include <fstream>
#include <iterator>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using tests::NilioProcess;
using tests::TemporaryFolder;

namespace {

std::string help_of(const TemporaryFolder& folder, const std::string& command) {
  NilioProcess nilio(folder.path() / "log", command + " --help");
  CHECK(nilio.end(0) == 0);
  return nilio.output();
}

/// Without line breaks and repeated blanks.
std::string in_one_line(const std::string& text) { return std::regex_replace(text, std::regex("\\s+"), " "); }

}  // namespace

TEST_CASE("docs/exit_status.md is the generated table", "[exit_status]") {
  std::ifstream file(nilio::tests::source_folder() + "/docs/exit_status.md");
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  INFO("regenerate with: nilio reference exit-status > docs/exit_status.md");
  CHECK(text == exit_status_reference());
}

TEST_CASE("every command of nilio explains its exit statuses in its help and in the table", "[exit_status]") {
  const TemporaryFolder folder;
  std::istringstream help(help_of(folder, ""));
  std::vector<std::string> commands;
  bool in_list = false;
  const std::regex entry("  ([a-z]+) +.*");
  for (std::string line; std::getline(help, line);) {
    std::smatch match;
    if (line == "Subcommands:") in_list = true;
    if (line.empty()) in_list = false;
    if (in_list && std::regex_match(line, match, entry)) commands.push_back(match[1]);
  }
  CHECK(commands.size() >= 11);
  const std::string general = exit_status_help("nilio");
  for (const std::string& command : commands) {
    CAPTURE(command);
    const std::string expected = exit_status_help("nilio " + command);
    CHECK(expected != general);
    CHECK(in_one_line(help_of(folder, command)).find(in_one_line(expected)) != std::string::npos);
    CHECK(exit_status_reference().find("| `nilio " + command + "` |") != std::string::npos);
  }
}

TEST_CASE("a page of the reference is printed, an unknown one is wrong usage", "[exit_status]") {
  const TemporaryFolder folder;
  {
    NilioProcess nilio(folder.path() / "log", "reference exit-status");
    CHECK(nilio.end(0) == kDone);
    CHECK(nilio.output() == exit_status_reference());
  }
  NilioProcess nilio(folder.path() / "log", "reference bogus");
  CHECK(nilio.end(0) == kUsageError);
}
