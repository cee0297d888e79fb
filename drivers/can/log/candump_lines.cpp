#include "nilio/core/units.hpp"

#include "drivers/can/log/log_lines.hpp"

#include <algorithm>
#include <cstdio>
#include <linux/can.h>

namespace nilio::drivers {
namespace {

/// Largest number of seconds whose nanoseconds fit int64.
constexpr std::int64_t kLargestSeconds = 9'000'000'000;

/// Parses hexadecimal byte pairs, optionally separated by points.
bool parse_data(std::string_view text, CanFrame& frame, std::size_t largest) {
  std::size_t count = 0;
  while (!text.empty()) {
    if (text.front() == '.') text.remove_prefix(1);
    if (text.size() < 2 || count >= largest) return false;
    if (!parse_whole(text.substr(0, 2), frame.data[count], 16)) return false;
    ++count;
    text.remove_prefix(2);
  }
  frame.length = static_cast<std::uint8_t>(count);
  return true;
}

/// Parses the text after "id#": data, "R" and a length, or "#", flags and data (CAN FD).
bool parse_content(std::string_view text, CanFrame& frame) {
  if (text.starts_with('#')) {
    unsigned flags = 0;
    if (text.size() < 2 || !parse_whole(text.substr(1, 1), flags, 16)) return false;
    frame.flexible_data_rate = true;
    return parse_data(text.substr(2), frame, frame.data.size());
  }
  // Classic frames of 8 bytes may end with their raw length code, 9 to F.
  if (text.size() >= 2 && text[text.size() - 2] == '_') text.remove_suffix(2);
  if (text.starts_with('R') || text.starts_with('r')) {
    frame.remote = true;
    text.remove_prefix(1);
    unsigned length = 0;
    if (!text.empty() && (!parse_whole(text, length) || length > 8)) return false;
    frame.length = static_cast<std::uint8_t>(length);
    return true;
  }
  return parse_data(text, frame, 8);
}

/// Parses "(seconds.fraction)" exactly.
bool parse_candump_stamp(std::string_view word, core::Time& stamp) {
  if (word.size() < 5 || word.front() != '(' || word.back() != ')') return false;
  word = word.substr(1, word.size() - 2);
  const std::size_t dot = word.find('.');
  if (dot == std::string_view::npos) return false;
  const std::string_view fraction = word.substr(dot + 1);
  std::uint64_t seconds = 0;
  std::uint32_t value = 0;
  if (fraction.size() > 9 || !parse_whole(word.substr(0, dot), seconds) || !parse_whole(fraction, value))
    return false;
  if (seconds > static_cast<std::uint64_t>(kLargestSeconds)) return false;
  std::int64_t ns = value;
  for (std::size_t digits = fraction.size(); digits < 9; ++digits) ns *= 10;
  stamp.ns = static_cast<std::int64_t>(seconds) * kNanosecondsPerSecond + ns;
  return true;
}

/// Parses 3 or 8 hexadecimal digits; bit 29 marks an error frame.
bool parse_candump_id(std::string_view text, CanFrame& frame) {
  std::uint32_t id = 0;
  if (!parse_whole(text, id, 16)) return false;
  if (text.size() == 3) {
    frame.id = id;
    return id <= CAN_SFF_MASK;
  }
  if (text.size() != 8) return false;
  frame.error = (id & CAN_ERR_FLAG) != 0;
  frame.extended = !frame.error;
  frame.id = id & CAN_EFF_MASK;
  return (id & ~(CAN_EFF_MASK | CAN_ERR_FLAG)) == 0;
}

/// candump pads absolute seconds to ten digits, relative ones to three.
constexpr std::size_t kAbsoluteDigits = 10;

bool take_stamp(std::string_view& line, CandumpTextLine& result) {
  std::string_view rest = line;
  const std::string_view word = take_word(rest);
  if (!word.starts_with('(')) return true;
  if (!parse_candump_stamp(word, result.line.frame.stamp)) return false;
  const bool absolute = word.find('.') > kAbsoluteDigits;
  result.clock = absolute ? CandumpClock::kAbsolute : CandumpClock::kRelative;
  line = rest;
  return true;
}

/// Skips the direction added by -x: "RX - -" or "TX B E".
void skip_direction(std::string_view& line) {
  std::string_view rest = line;
  const std::string_view word = take_word(rest);
  if (word != "RX" && word != "TX") return;
  take_word(rest);
  take_word(rest);
  line = rest;
}

/// Parses "[8]"; two digits mark CAN FD.
bool take_length(std::string_view& line, CanFrame& frame) {
  const std::string_view word = take_word(line);
  if (word.size() < 3 || word.front() != '[' || word.back() != ']') return false;
  const std::string_view digits = word.substr(1, word.size() - 2);
  frame.flexible_data_rate = digits.size() == 2;
  return parse_whole(digits, frame.length) && frame.length <= (frame.flexible_data_rate ? 64 : 8);
}

bool take_data(std::string_view line, CanFrame& frame) {
  for (std::size_t i = 0; i < frame.length; ++i) {
    const std::string_view word = take_word(line);
    if (i == 0 && word == "remote") {
      frame.remote = true;
      return take_word(line) == "request";
    }
    if (word.size() != 2 || !parse_whole(word, frame.data[i], 16)) return false;
  }
  const std::string_view rest = take_word(line);
  if (frame.length == 0 && rest == "remote") {
    frame.remote = true;
    return true;
  }
  // The rest may be the data as text (-a) or the mark of an error frame; the identifier marks it, too.
  return rest.empty() || rest.starts_with('\'') || rest == "ERRORFRAME";
}

}  // namespace

std::optional<CandumpLine> parse_candump_line(std::string_view line) {
  while (!line.empty() && (line.back() == '\n' || line.back() == '\r')) line.remove_suffix(1);
  CandumpLine result;
  const std::string_view stamp = take_word(line);
  const std::string_view interface_name = take_word(line);
  const std::string_view content = take_word(line);
  const std::string_view direction = take_word(line);
  const std::size_t hash = content.find('#');
  const bool direction_valid = direction.empty() || direction == "R" || direction == "T";
  if (hash == std::string_view::npos || !direction_valid || !take_word(line).empty()) return std::nullopt;
  if (!parse_candump_stamp(stamp, result.frame.stamp) ||
      !parse_candump_id(content.substr(0, hash), result.frame) ||
      !parse_content(content.substr(hash + 1), result.frame)) {
    return std::nullopt;
  }
  result.interface_name = interface_name;
  return result;
}

std::string format_candump_line(const CanFrame& frame, std::string_view interface_name) {
  std::array<char, 48> text{};
  const std::int64_t stamp = std::max<std::int64_t>(frame.stamp.ns, 0);
  const long long seconds = stamp / kNanosecondsPerSecond;
  const long long fraction = stamp % kNanosecondsPerSecond;
  // Every tool reads six digits; nine only where six would lose precision.
  if (fraction % 1000 == 0) {
    std::snprintf(text.data(), text.size(), "(%010lld.%06lld) ", seconds, fraction / 1000);
  } else {
    std::snprintf(text.data(), text.size(), "(%010lld.%09lld) ", seconds, fraction);
  }
  std::string line = text.data();
  line += interface_name;
  const bool wide = frame.extended || frame.error;
  std::snprintf(text.data(), text.size(), wide ? " %08X#" : " %03X#",
                frame.id | (frame.error ? CAN_ERR_FLAG : 0U));
  line += text.data();
  if (frame.flexible_data_rate) line += "#0";
  if (frame.remote) {
    line += 'R';
    if (frame.length > 0) line += std::to_string(std::min<unsigned>(frame.length, 8U));
    return line;
  }
  for (std::size_t i = 0; i < std::min<std::size_t>(frame.length, frame.data.size()); ++i) {
    std::snprintf(text.data(), text.size(), "%02X", static_cast<unsigned>(frame.data[i]));
    line += text.data();
  }
  return line;
}

std::optional<CandumpTextLine> parse_candump_text_line(std::string_view line) {
  while (!line.empty() && (line.back() == '\n' || line.back() == '\r')) line.remove_suffix(1);
  CandumpTextLine result;
  if (!take_stamp(line, result)) return std::nullopt;
  CanFrame& frame = result.line.frame;
  result.line.interface_name = take_word(line);
  skip_direction(line);
  if (!parse_candump_id(take_word(line), frame) || !take_length(line, frame) || !take_data(line, frame)) {
    return std::nullopt;
  }
  return result;
}

}  // namespace nilio::drivers
