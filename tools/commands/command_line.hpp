#pragma once

#include <algorithm>
#include <cstddef>
#include <sstream>
#include <string>
#include <utility>

#include <CLI/CLI.hpp>

namespace nilio::tools {

/// Validator of a number in a range; unlike CLI::Range it rejects "nan".
inline CLI::Validator number_between(double low, double high) {
  std::ostringstream range;
  range << low << " to " << high;
  const auto check = [low, high, text = range.str()](std::string& given) {
    double value = 0.0;
    const bool good = CLI::detail::lexical_cast(given, value) && value >= low && value <= high;
    return good ? std::string() : "'" + given + "' is not a number from " + text;
  };
  return {check, range.str()};
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
      const std::size_t space = line.find_last_of(' ', kColumns);
      if (space == std::string::npos || space <= indent.size()) break;
      text += line.substr(0, space) + "\n";
      line = indent + line.substr(space + 1);
    }
    return text + line;
  }
};

}  // namespace nilio::tools
