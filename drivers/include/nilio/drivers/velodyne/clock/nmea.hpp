#pragma once

#include "nilio/core/time.hpp"

#include <cstdint>
#include <optional>
#include <string_view>

namespace nilio::drivers {

enum class NmeaSentence : std::uint8_t { kRmc, kGga };

/// What an RMC or GGA sentence says; empty fields are absent.
struct NmeaFix {
  NmeaSentence sentence = NmeaSentence::kRmc;
  /// RMC: status A; GGA: a fix quality other than 0. Time may be used only where this is true.
  bool valid = false;
  /// UTC since midnight.
  std::optional<core::Duration> time_of_day;
  /// Only with a date, which GGA has not.
  std::optional<core::Time> utc;
  /// The receiver's date was a multiple of 1024 weeks away from the host's and was moved.
  bool week_rollover_corrected = false;
  /// North and east positive.
  std::optional<double> latitude_deg;
  std::optional<double> longitude_deg;
  /// RMC.
  std::optional<double> speed_m_s;
  /// RMC: over ground, clockwise from north.
  std::optional<double> course_deg;
  /// GGA: antenna above mean sea level.
  std::optional<double> altitude_m;
};

/// Reads an RMC or GGA sentence of any talker (GPRMC, GNRMC, ...), with or without '$' and line end; zero
/// bytes after it are ignored. Nothing for other sentences, a missing or wrong checksum (either case), a
/// field that is not what it should be, or a date or time that does not exist. Two-digit years are 1980 to
/// 2079.
///
/// With the `host`'s date, the date of a receiver whose week counter has rolled over (it is a multiple of
/// 1024 weeks off, to within a day) is corrected; any other difference is left as it is.
///
/// Thread-safe, does not allocate.
std::optional<NmeaFix> parse_nmea(std::string_view text, std::optional<core::Time> host = std::nullopt);

}  // namespace nilio::drivers
