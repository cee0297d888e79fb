#include "drivers/can/log/candump_words.hpp"

namespace nilio::drivers {
namespace {

/// candump fills absolute seconds up to ten digits, relative ones up to three.
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

/// "RX - -" or "TX B E", which -x adds.
void skip_direction(std::string_view& line) {
  std::string_view rest = line;
  const std::string_view word = take_word(rest);
  if (word != "RX" && word != "TX") return;
  take_word(rest);
  take_word(rest);
  line = rest;
}

/// "[8]", or with two digits for CAN FD.
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
  // The data as text (-a), or the mark of an error frame, which its identifier has, too.
  return rest.empty() || rest.starts_with('\'') || rest == "ERRORFRAME";
}

}  // namespace

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
