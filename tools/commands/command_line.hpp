#pragma once

#include "daemon/command_line.hpp"

#include <sstream>
#include <string>

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

}  // namespace nilio::tools
