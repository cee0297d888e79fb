#include "nilio/drivers/velodyne/clock/nmea.hpp"

#include "nilio/core/units.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cmath>

namespace nilio::drivers {
namespace {

constexpr std::int64_t kDayNs = 86'400 * kNanosecondsPerSecond;
constexpr std::int64_t kGpsEraNs = std::int64_t{1024} * 7 * kDayNs;
constexpr double kMetresPerSecondPerKnot = 1852.0 / 3600.0;

std::optional<int> hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  return std::nullopt;
}

/// Text between '$' and '*'; nothing if the checksum is wrong or text other than the line end follows.
std::optional<std::string_view> checked_body(std::string_view text) {
  text = text.substr(0, text.find('\0'));
  while (!text.empty() && (text.back() == '\r' || text.back() == '\n')) text.remove_suffix(1);
  if (!text.empty() && text.front() == '$') text.remove_prefix(1);
  const std::size_t star = text.find('*');
  if (star == std::string_view::npos || text.size() != star + 3) return std::nullopt;
  const std::optional<int> high = hex_digit(text[star + 1]);
  const std::optional<int> low = hex_digit(text[star + 2]);
  if (!high || !low) return std::nullopt;
  int sum = 0;
  for (const char c : text.substr(0, star)) {
    if (c < ' ' || c > '~') return std::nullopt;
    sum ^= c;
  }
  if (sum != *high * 16 + *low) return std::nullopt;
  return text.substr(0, star);
}

/// Comma-separated fields; fields beyond the last are empty.
class Fields {
 public:
  explicit Fields(std::string_view body) {
    while (count_ < fields_.size()) {
      const std::size_t comma = body.find(',');
      fields_[count_++] = body.substr(0, comma);
      if (comma == std::string_view::npos) return;
      body.remove_prefix(comma + 1);
    }
  }
  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] std::string_view operator[](std::size_t i) const { return fields_[i]; }

 private:
  /// The longest form of RMC has 14 fields, GGA 15.
  std::array<std::string_view, 16> fields_{};
  std::size_t count_ = 0;
};

/// Parses fields; ok() turns false at the first malformed one.
class Reader {
 public:
  [[nodiscard]] bool ok() const { return ok_; }

  /// Parses digits, a point, and a sign if `lowest` is negative; nothing for an empty field.
  std::optional<double> number(std::string_view field, double lowest, double highest) {
    if (field.empty()) return std::nullopt;
    double value = 0.0;
    const char* const end = field.data() + field.size();
    const bool plain = field.find_first_not_of("0123456789.-") == std::string_view::npos;
    const auto [stop, failure] = std::from_chars(field.data(), end, value, std::chars_format::fixed);
    if (!plain || failure != std::errc{} || stop != end || value < lowest || value > highest) return fail();
    return value;
  }

  /// Parses `dddmm.mmm` and its hemisphere, one of `signs` (positive, negative).
  std::optional<double> angle(std::string_view field, std::string_view hemisphere, std::string_view signs,
                              double highest_deg) {
    if (field.empty() || hemisphere.empty()) return std::nullopt;
    const std::optional<double> value = number(field, 0.0, highest_deg * 100.0);
    if (!value || hemisphere.size() != 1 || signs.find(hemisphere[0]) == std::string_view::npos)
      return fail();
    const double degrees = std::floor(*value / 100.0);
    const double minutes = *value - degrees * 100.0;
    if (minutes >= 60.0) return fail();
    return (hemisphere[0] == signs[0] ? 1.0 : -1.0) * (degrees + minutes / 60.0);
  }

  /// Parses `hhmmss` or `hhmmss.sss`; a leap second (60) is the first of the next minute.
  std::optional<core::Duration> time_of_day(std::string_view field) {
    if (field.empty()) return std::nullopt;
    const auto hours = pair(field, 0, 23);
    const auto minutes = pair(field, 2, 59);
    const auto seconds = pair(field, 4, 60);
    const auto fraction = field.size() > 6 ? fraction_ns(field.substr(6)) : std::optional<std::int64_t>(0);
    if (!hours || !minutes || !seconds || !fraction) {
      ok_ = false;
      return std::nullopt;
    }
    return core::Duration{((*hours * 60 + *minutes) * 60 + *seconds) * kNanosecondsPerSecond + *fraction};
  }

  /// Parses `ddmmyy`; returns its midnight.
  std::optional<core::Time> date(std::string_view field) {
    if (field.empty()) return std::nullopt;
    const auto day = pair(field, 0, 31);
    const auto month = pair(field, 2, 12);
    const auto year = pair(field, 4, 99);
    if (field.size() != 6 || !day || !month || !year) {
      ok_ = false;
      return std::nullopt;
    }
    const std::chrono::year_month_day date{
        std::chrono::year{static_cast<int>(*year < 80 ? 2000 + *year : 1900 + *year)},
        std::chrono::month{static_cast<unsigned>(*month)}, std::chrono::day{static_cast<unsigned>(*day)}};
    if (!date.ok()) {
      ok_ = false;
      return std::nullopt;
    }
    return core::Time{std::chrono::sys_days{date}.time_since_epoch().count() * kDayNs};
  }

  /// Parses one of two letters; true for `yes`, false for `no` and an empty field.
  bool flag(std::string_view field, char yes, char no) {
    if (field.empty()) return false;
    ok_ = ok_ && field.size() == 1 && (field[0] == yes || field[0] == no);
    return field[0] == yes;
  }

 private:
  static bool digit(char c) { return c >= '0' && c <= '9'; }

  static std::optional<std::int64_t> pair(std::string_view field, std::size_t at, std::int64_t highest) {
    if (field.size() < at + 2 || !digit(field[at]) || !digit(field[at + 1])) return std::nullopt;
    const std::int64_t value = (field[at] - '0') * 10 + (field[at + 1] - '0');
    return value <= highest ? std::optional(value) : std::nullopt;
  }

  /// Parses ".sss"; digits below a nanosecond are dropped.
  static std::optional<std::int64_t> fraction_ns(std::string_view text) {
    if (text.front() != '.') return std::nullopt;
    text.remove_prefix(1);
    if (!std::all_of(text.begin(), text.end(), digit)) return std::nullopt;
    std::int64_t value = 0;
    for (std::size_t i = 0; i < 9; ++i) value = value * 10 + (i < text.size() ? text[i] - '0' : 0);
    return value;
  }

  std::optional<double> fail() {
    ok_ = false;
    return std::nullopt;
  }

  bool ok_ = true;
};

/// Multiple of 1024 weeks between the receiver's date and the host's, to within a day; 0 for any other
/// difference.
core::Duration week_rollover(core::Time receiver, core::Time host) {
  const std::int64_t difference = (host - receiver).ns;
  const std::int64_t half = difference < 0 ? -kGpsEraNs / 2 : kGpsEraNs / 2;
  const std::int64_t shift = (difference + half) / kGpsEraNs * kGpsEraNs;
  const std::int64_t rest = difference - shift;
  return core::Duration{rest >= -kDayNs && rest <= kDayNs ? shift : 0};
}

std::optional<NmeaFix> read_rmc(const Fields& fields, std::optional<core::Time> host) {
  if (fields.count() < 10) return std::nullopt;
  Reader reader;
  NmeaFix fix;
  fix.sentence = NmeaSentence::kRmc;
  fix.time_of_day = reader.time_of_day(fields[1]);
  fix.valid = reader.flag(fields[2], 'A', 'V');
  fix.latitude_deg = reader.angle(fields[3], fields[4], "NS", 90.0);
  fix.longitude_deg = reader.angle(fields[5], fields[6], "EW", 180.0);
  if (const auto knots = reader.number(fields[7], 0.0, 1e4)) fix.speed_m_s = *knots * kMetresPerSecondPerKnot;
  fix.course_deg = reader.number(fields[8], 0.0, 360.0);
  const std::optional<core::Time> date = reader.date(fields[9]);
  if (!reader.ok()) return std::nullopt;
  if (date && fix.time_of_day) {
    fix.utc = *date + *fix.time_of_day;
    const core::Duration shift = host ? week_rollover(*fix.utc, *host) : core::Duration{};
    fix.utc = *fix.utc + shift;
    fix.week_rollover_corrected = shift.ns != 0;
  }
  return fix;
}

std::optional<NmeaFix> read_gga(const Fields& fields) {
  if (fields.count() < 10) return std::nullopt;
  Reader reader;
  NmeaFix fix;
  fix.sentence = NmeaSentence::kGga;
  fix.time_of_day = reader.time_of_day(fields[1]);
  fix.latitude_deg = reader.angle(fields[2], fields[3], "NS", 90.0);
  fix.longitude_deg = reader.angle(fields[4], fields[5], "EW", 180.0);
  fix.quality = static_cast<int>(reader.number(fields[6], 0.0, 9.0).value_or(0.0));
  fix.valid = fix.quality > 0;
  fix.altitude_m = reader.number(fields[9], -1e4, 1e6);
  fix.geoid_height_m = reader.number(fields[11], -1e3, 1e3);
  if (!reader.ok()) return std::nullopt;
  return fix;
}

}  // namespace

std::optional<NmeaFix> parse_nmea(std::string_view text, std::optional<core::Time> host) {
  const std::optional<std::string_view> body = checked_body(text);
  if (!body) return std::nullopt;
  const Fields fields(*body);
  if (fields[0].size() != 5) return std::nullopt;
  const std::string_view formatter = fields[0].substr(2);
  if (formatter == "RMC") return read_rmc(fields, host);
  if (formatter == "GGA") return read_gga(fields);
  return std::nullopt;
}

}  // namespace nilio::drivers
