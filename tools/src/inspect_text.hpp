#pragma once

#include "nilio/core/time.hpp"

#include <string>

namespace nilio::tools {

/// printf into a string.
[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...);

/// "2024-05-01 12:00:00.123", UTC.
std::string utc_text(core::Time time);

/// A span of time in the unit that suits it: "12.3 ms", "1.500 s", "2 h 05 min".
std::string span_text(double seconds);

}  // namespace nilio::tools
