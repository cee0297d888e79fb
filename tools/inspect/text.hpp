#pragma once

#include "nilio/core/time.hpp"

#include <string>
#include <string_view>

namespace nilio::tools::inspect {

/// printf into a string.
[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...);

/// "2024-05-01 12:00:00.123", UTC.
std::string utc_text(core::Time time);

/// With '?' for everything that may not reach a terminal: what files and packets hold is not trusted.
std::string printable_text(std::string_view text);

/// A line of a table whose last columns may be empty, with its end.
std::string without_trailing_space(std::string line);

/// A span of time in the unit that suits it: "12.3 ms", "1.500 s", "2.5 h".
std::string span_text(double seconds);

}  // namespace nilio::tools::inspect
