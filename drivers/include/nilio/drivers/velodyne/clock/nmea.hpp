#pragma once

#include "nilio/core/time.hpp"

#include <cstdint>
#include <optional>
#include <string_view>

namespace nilio::drivers {

enum class NmeaSentence : std::uint8_t { kRmc, kGga };

/// Content of an RMC or GGA sentence; empty fields are absent.
struct NmeaFix {
  NmeaSentence sentence = NmeaSentence::kRmc;
  /// RMC: status A; GGA: a fix quality other than 0. Time may be used only where this is true.
  bool valid = false;
  /// UTC since midnight.
  std::optional<core::Duration> time_of_day;
  /// Only with a date, which GGA lacks.
  std::optional<core::Time> utc;
  /// The receiver's date was off by a multiple of 1024 weeks and was corrected.
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
  /// GGA: mean sea level above the WGS 84 ellipsoid.
  std::optional<double> geoid_height_m;
  /// GGA: 0 none, 1 autonomous, 2 differential, 3 precise, 4 RTK, 5 RTK float, 6 estimated, 7 manual, 8
  /// simulated.
  int quality = 0;
};

/// Reads an RMC or GGA sentence of any talker (GPRMC, GNRMC, ...), with or without '$' and line end; zero
/// bytes after it are ignored. Returns nothing for other sentences, a missing or wrong
/// checksum (upper or lower case), a malformed field, or an invalid date or time. Two-digit years are 1980 to
/// 2079.
///
/// With the `host`'s time, the date of a receiver whose week counter has rolled over is corrected, that is
/// one off by a multiple of 1024 weeks to within a day; any other difference is kept.
///
/// Thread-safe, does not allocate.
std::optional<NmeaFix> parse_nmea(std::string_view text, std::optional<core::Time> host = std::nullopt);

}  // namespace nilio::drivers
