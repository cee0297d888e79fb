#include "nilio/core/units.hpp"

#include "drivers/can/log/log_lines.hpp"

#include <array>
#include <charconv>
#include <ctime>
#include <linux/can.h>

namespace nilio::drivers {
namespace {

/// Upper limit of a recording's length; sums with a date stay within 64 bits.
constexpr double kLongestSeconds = 1e9;
constexpr unsigned kMostChannels = 255;
constexpr std::array<std::string_view, 12> kMonths{"jan", "feb", "mar", "apr", "may", "jun",
                                                   "jul", "aug", "sep", "oct", "nov", "dec"};
/// German abbreviations that differ from the English ones.
constexpr std::array<std::pair<std::string_view, int>, 5> kFurtherMonths{
    {{"m\xE4r", 2}, {"m\xC3\xA4", 2}, {"mai", 4}, {"okt", 9}, {"dez", 11}}};

bool parse_seconds(std::string_view text, double& value) {
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
  return code == std::errc{} && end == text.data() + text.size() && value >= 0.0 && value < kLongestSeconds;
}

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

std::optional<int> month_of(std::string_view word) {
  if (word.size() < 3) return std::nullopt;
  const std::array<char, 3> letters{lower(word[0]), lower(word[1]), lower(word[2])};
  const std::string_view name(letters.data(), letters.size());
  for (std::size_t i = 0; i < kMonths.size(); ++i) {
    if (name == kMonths[i]) return static_cast<int>(i);
  }
  for (const auto& [month, number] : kFurtherMonths) {
    if (name == month) return number;
  }
  return std::nullopt;
}

/// Parses "22:13:20" or "22:13:20.123".
bool parse_clock(std::string_view word, std::tm& date, double& fraction) {
  const std::size_t dot = std::min(word.find('.'), word.size());
  if (dot < word.size() && !parse_seconds(word.substr(dot), fraction)) return false;
  word = word.substr(0, dot);
  return word.size() == 8 && word[2] == ':' && word[5] == ':' &&
         parse_whole(word.substr(0, 2), date.tm_hour) && parse_whole(word.substr(3, 2), date.tm_min) &&
         parse_whole(word.substr(6, 2), date.tm_sec);
}

bool take_channel(std::string_view& rest, CandumpLine& result) {
  unsigned channel = 0;
  if (!parse_whole(take_word(rest), channel) || channel == 0 || channel > kMostChannels) return false;
  result.interface_name = "can" + std::to_string(channel - 1);
  return true;
}

bool is_direction(std::string_view word) { return word == "Rx" || word == "Tx" || word == "TxRq"; }

}  // namespace

bool AscLog::is_first_line(std::string_view line) {
  return line.starts_with("date ") || line.starts_with("base ");
}

AscLog::Kind AscLog::read(std::string_view line, CandumpLine& result) {
  while (!line.empty() && (line.back() == '\n' || line.back() == '\r')) line.remove_suffix(1);
  std::string_view rest = line;
  const std::string_view first = take_word(rest);
  if (first == "date") read_date(rest);
  if (first == "base") {
    base_ = take_word(rest) == "dec" ? 10 : 16;
    take_word(rest);
    times_are_steps_ = take_word(rest) == "relative";
  }
  double seconds = 0.0;
  if (!parse_seconds(first, seconds)) return Kind::kOther;
  const std::int64_t time_ns = core::Duration::from_seconds(seconds).ns;
  if (times_are_steps_ && last_ns_ > static_cast<std::int64_t>(kLongestSeconds) * kNanosecondsPerSecond)
    return Kind::kBroken;
  last_ns_ = times_are_steps_ ? last_ns_ + time_ns : time_ns;
  result.frame.stamp.ns = start_ns_ + last_ns_;
  std::string_view after_channel = rest;
  const std::string_view kind = take_word(after_channel);
  if (kind == "CANFD") return read_flexible(after_channel, result) ? Kind::kFrame : Kind::kBroken;
  // Events of other buses and statistics have no channel and identifier here.
  unsigned channel = 0;
  if (!parse_whole(kind, channel)) return Kind::kOther;
  const std::string_view next = take_word(after_channel);
  if (next.starts_with("Statistic")) return Kind::kOther;
  return read_classic(rest, result) ? Kind::kFrame : Kind::kBroken;
}

/// Parses "Tue Nov 14 22:13:20.123 pm 2023".
void AscLog::read_date(std::string_view rest) {
  std::tm date{};
  double fraction = 0.0;
  take_word(rest);
  const std::optional<int> month = month_of(take_word(rest));
  const bool valid =
      month && parse_whole(take_word(rest), date.tm_mday) && parse_clock(take_word(rest), date, fraction);
  std::string_view year = take_word(rest);
  if (year == "am" || year == "pm") {
    date.tm_hour = date.tm_hour % 12 + (year == "pm" ? 12 : 0);
    year = take_word(rest);
  }
  if (!valid || !parse_whole(year, date.tm_year) || date.tm_mday < 1 || date.tm_mday > 31 ||
      date.tm_year < 1970 || date.tm_year > 2100)
    return;
  date.tm_mon = *month;
  date.tm_year -= 1900;
  start_ns_ = static_cast<std::int64_t>(timegm(&date)) * kNanosecondsPerSecond +
              core::Duration::from_seconds(fraction).ns;
}

/// Parses "1  1ABCDEF0x  Rx  d 3 01 02 FF", "1  123  Rx  r 0" or "1  ErrorFrame".
bool AscLog::read_classic(std::string_view rest, CandumpLine& result) const {
  CanFrame& frame = result.frame;
  if (!take_channel(rest, result)) return false;
  const std::string_view id = take_word(rest);
  if (id == "ErrorFrame") {
    frame.error = true;
    frame.length = 8;
    return true;
  }
  if (!read_id(id, frame) || !is_direction(take_word(rest))) return false;
  const std::string_view kind = take_word(rest);
  frame.remote = kind == "r";
  if (kind != "d" && !frame.remote) return false;
  const std::string_view length = take_word(rest);
  if (frame.remote && length.empty()) return true;
  unsigned code = 0;
  if (!parse_whole(length, code, 16) || code > 15) return false;
  // Length codes above 8 also mean 8 bytes.
  frame.length = static_cast<std::uint8_t>(std::min(code, 8U));
  return frame.remote || read_data(rest, frame);
}

/// Parses "1 Rx  123  [name]  1 0 9 12 01 02 ...": bit rate switch, error state, length code, length, data.
bool AscLog::read_flexible(std::string_view rest, CandumpLine& result) const {
  CanFrame& frame = result.frame;
  if (!take_channel(rest, result) || !is_direction(take_word(rest)) || !read_id(take_word(rest), frame))
    return false;
  std::string_view word = take_word(rest);
  // The optional name is never a single digit.
  if (word != "0" && word != "1") word = take_word(rest);
  if (word != "0" && word != "1") return false;
  take_word(rest);
  take_word(rest);
  unsigned length = 0;
  if (!parse_whole(take_word(rest), length) || length > frame.data.size()) return false;
  frame.flexible_data_rate = true;
  frame.length = static_cast<std::uint8_t>(length);
  return read_data(rest, frame);
}

bool AscLog::read_id(std::string_view word, CanFrame& frame) const {
  frame.extended = word.ends_with('x');
  if (frame.extended) word.remove_suffix(1);
  return parse_whole(word, frame.id, base_) && frame.id <= (frame.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
}

bool AscLog::read_data(std::string_view rest, CanFrame& frame) const {
  for (std::size_t i = 0; i < frame.length; ++i) {
    if (!parse_whole(take_word(rest), frame.data[i], base_)) return false;
  }
  return true;
}

}  // namespace nilio::drivers
