#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/can/can_files.hpp"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string_view>
#include <system_error>

namespace nilio::drivers {

/// Parses a whole text as a number; false when any character remains.
template <class Number>
bool parse_whole(std::string_view text, Number& value, int base = 10) {
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  return !text.empty() && code == std::errc{} && end == text.data() + text.size();
}

/// Removes the next word from the front of `line` and returns it.
inline std::string_view take_word(std::string_view& line) {
  const std::size_t begin = std::min(line.find_first_not_of(" \t"), line.size());
  line.remove_prefix(begin);
  const std::size_t end = std::min(line.find_first_of(" \t"), line.size());
  const std::string_view word = line.substr(0, end);
  line.remove_prefix(end);
  return word;
}

/// Origin of a line's time.
enum class CandumpClock {
  kAbsolute,  ///< the epoch
  kRelative,  ///< the first line or the previous line: only the whole log shows which
  kNone,      ///< the line has no time
};

struct CandumpTextLine {
  CandumpLine line;
  CandumpClock clock = CandumpClock::kNone;
};

/// Parses a line of candump's terminal output: " (1700000000.123456)  can0  034   [6]  00 00 00 00 09 CF",
/// with or without time (-ta, -td, -tz) and direction (-x).
std::optional<CandumpTextLine> parse_candump_text_line(std::string_view line);

/// Reads Vector's ASC logs line by line. Channel 1 is interface can0, as for asc2log. The file's date has no
/// time zone and is taken as UTC; times of a log with an unreadable date count from 1970.
class AscLog {
 public:
  /// True for the first line of such logs.
  static bool is_first_line(std::string_view line);

  enum class Kind {
    kFrame,
    kOther,  ///< headers, comments and events that are no frames
    kBroken,
  };
  Kind read(std::string_view line, CandumpLine& result);

 private:
  void read_date(std::string_view rest);
  bool read_classic(std::string_view rest, CandumpLine& result) const;
  bool read_flexible(std::string_view rest, CandumpLine& result) const;
  bool read_id(std::string_view word, CanFrame& frame) const;
  bool read_data(std::string_view rest, CanFrame& frame) const;

  int base_ = 16;
  bool times_are_steps_ = false;
  std::int64_t start_ns_ = 0;
  std::int64_t last_ns_ = 0;
};

}  // namespace nilio::drivers
