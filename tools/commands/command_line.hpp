#pragma once

#include "daemon/command_line.hpp"
#include "tools/gnss/georeference.hpp"

#include <cmath>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

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

/// Option --origin LAT,LON,ALT,HEADING; `explanation` begins its help.
inline void add_origin_option(CLI::App& command, std::optional<gnss::GeodeticOrigin>& origin,
                              const std::string& explanation) {
  command
      .add_option_function<std::vector<double>>(
          "--origin",
          [&origin](const std::vector<double>& v) {
            const bool is_place = std::abs(v[0]) <= 90.0 && std::abs(v[1]) <= 180.0 &&
                                  std::abs(v[2]) <= 100'000.0 && std::abs(v[3]) <= 360.0;
            if (!is_place) throw CLI::ValidationError("--origin", "is no place: LAT,LON,ALT,HEADING");
            origin = {v[0], v[1], v[2], v[3]};
          },
          explanation +
              ": latitude and longitude in degrees, altitude in metres and heading of the x axis in degrees "
              "clockwise from north: LAT,LON,ALT,HEADING")
      ->delimiter(',')
      ->expected(4);
}

/// --antenna and --time-offset of commands that place a trajectory by GNSS.
inline void add_georeference_options(CLI::App& command, gnss::GeoreferenceOptions& options) {
  command
      .add_option_function<std::vector<double>>(
          "--antenna",
          [&options](const std::vector<double>& place) { options.antenna << place[0], place[1], place[2]; },
          "GNSS: the antenna in base_link, metres: X,Y,Z (default 0,0,0)")
      ->delimiter(',')
      ->expected(3);
  command
      .add_option_function<double>(
          "--time-offset",
          [&options](double seconds) { options.time_offset = core::Duration::from_seconds(seconds); },
          "GNSS: seconds to add to the times of the positions")
      ->check(CLI::Range(-1e6, 1e6));
}

}  // namespace nilio::tools
