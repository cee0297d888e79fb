#pragma once

#include "daemon/command_line.hpp"

#include <map>
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

/// Values of an enumeration by their names, in any case. --help lists the names only; CLI::CheckedTransformer
/// itself lists the numbers behind them as well, or the bytes.
template <typename Enum>
CLI::Validator choice_of(std::map<std::string, Enum> values) {
  std::string names;
  for (const auto& [name, value] : values) names += (names.empty() ? "{" : ",") + name;
  CLI::CheckedTransformer transformer(std::move(values), CLI::ignore_case);
  return transformer.description(names + "}");
}

}  // namespace nilio::tools
