#pragma once

#include "daemon/exit_status.hpp"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <sstream>
#include <string>
#include <utility>

#include <CLI/CLI.hpp>

namespace nilio {

/// Parses the command line. Returns the exit status if the program ends with it: after --help, for a usage
/// error, and for a command that failed with CLI::RuntimeError.
inline std::optional<int> parse_command_line(CLI::App& app, int argc, const char* const* argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::RuntimeError& error) {
    return error.get_exit_code();
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kDone : kUsageError;
  }
  return std::nullopt;
}

/// Breaks the lines of help texts at 100 columns. Continuation lines of an option's description keep its
/// column, those of other texts the text's own indentation.
class HelpFormatter : public CLI::Formatter {
 public:
  static constexpr std::size_t kColumns = 100;

  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override {
    std::istringstream help(Formatter::make_help(app, std::move(name), mode));
    std::string text;
    for (std::string line; std::getline(help, line);) text += wrapped(std::move(line)) + "\n";
    return text;
  }

 private:
  [[nodiscard]] std::string wrapped(std::string line) const {
    const std::size_t first = std::min(line.find_first_not_of(' '), line.size());
    const bool is_option = first > 0 && first < get_column_width();
    const std::string indent(is_option ? get_column_width() : first, ' ');
    std::string text;
    while (line.size() > kColumns) {
      const auto is_inside = [&](std::size_t at) { return at != std::string::npos && at > indent.size(); };
      // A list of choices has no spaces: it is broken after a comma.
      std::size_t end = line.find_last_of(' ', kColumns);
      if (!is_inside(end)) end = line.find_last_of(',', kColumns - 1);
      if (!is_inside(end)) break;
      text += line.substr(0, line[end] == ',' ? end + 1 : end) + "\n";
      line = indent + line.substr(end + 1);
    }
    return text + line;
  }
};

}  // namespace nilio
