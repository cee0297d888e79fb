#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/can/log/candump.hpp"

#include <algorithm>
#include <charconv>
#include <optional>
#include <string_view>
#include <system_error>

namespace nilio::drivers {

template <class Number>
bool parse_whole(std::string_view text, Number& value, int base = 10) {
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  return !text.empty() && code == std::errc{} && end == text.data() + text.size();
}

/// The next word, taken off the front of `line`.
inline std::string_view take_word(std::string_view& line) {
  const std::size_t begin = std::min(line.find_first_not_of(" \t"), line.size());
  line.remove_prefix(begin);
  const std::size_t end = std::min(line.find_first_of(" \t"), line.size());
  const std::string_view word = line.substr(0, end);
  line.remove_prefix(end);
  return word;
}

/// "(seconds.fraction)", exactly.
bool parse_candump_stamp(std::string_view word, core::Time& stamp);
/// 3 or 8 hexadecimal digits, in which bit 29 marks an error frame.
bool parse_candump_id(std::string_view text, CanFrame& frame);

/// When a line's time counts from.
enum class CandumpClock {
  kAbsolute,  ///< the epoch
  kRelative,  ///< the first line, or the line before: which, only the whole log can tell
  kNone,      ///< the line has no time
};

struct CandumpTextLine {
  CandumpLine line;
  CandumpClock clock = CandumpClock::kNone;
};

/// What candump shows on a terminal: " (1700000000.123456)  can0  034   [6]  00 00 00 00 09 CF", with or
/// without time (-ta, -td, -tz) and direction (-x).
std::optional<CandumpTextLine> parse_candump_text_line(std::string_view line);

}  // namespace nilio::drivers
