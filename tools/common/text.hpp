#pragma once

#include "nilio/core/time.hpp"

#include <string>
#include <string_view>

namespace nilio::tools {

/// printf into a string.
[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...);

/// Seconds with nine decimals, as in trajectory.tum.
std::string stamp_text(core::Time stamp);

/// "2023-11-14T22:13:20.100Z".
std::string iso_text(core::Time stamp);

/// "2024-05-01 12:00:00.123", UTC.
std::string utc_text(core::Time time);

/// Replaces characters that could control a terminal by '?': contents of files and packets are untrusted.
std::string printable_text(std::string_view text);

/// Ends a table row whose last columns may be empty.
std::string without_trailing_space(std::string line);

/// A span of time in a suitable unit: "12.3 ms", "1.500 s", "2.5 h".
std::string span_text(double seconds);

}  // namespace nilio::tools
