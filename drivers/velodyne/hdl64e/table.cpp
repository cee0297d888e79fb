#include "drivers/velodyne/hdl64e/table.hpp"

#include "nilio/core/units.hpp"

#include "drivers/common/byte_order.hpp"
#include "drivers/velodyne/calibration/calibration_fields.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

namespace nilio::drivers {
namespace {

constexpr std::size_t kWordsPerLaser = 9;
constexpr std::size_t kLaserBytes = 1 + 2 * kWordsPerLaser + 2;
constexpr std::size_t kDateCycle = 256;
constexpr std::size_t kMotorCycle = 257;
constexpr std::size_t kAddressCycle = 258;
constexpr std::size_t kLastCycle = 259;

/// A word of a laser, in stream order.
struct LaserWord {
  double LaserCalibration::*target;
  double step;
};

constexpr double kAngleStep = 0.01 * kXmlUnits.angle;
constexpr std::array<LaserWord, kWordsPerLaser> kWords{{
    {&LaserCalibration::elevation_rad, kAngleStep},
    {&LaserCalibration::azimuth_correction_rad, kAngleStep},
    {&LaserCalibration::distance_correction_m, 1e-3},
    {&LaserCalibration::near_distance_correction_x_m, 1e-3},
    {&LaserCalibration::near_distance_correction_y_m, 1e-3},
    {&LaserCalibration::vertical_offset_m, 1e-3},
    {&LaserCalibration::horizontal_offset_m, 1e-3},
    {&LaserCalibration::focal_distance_m, 1e-3},
    {&LaserCalibration::focal_slope, 0.1},
}};

constexpr std::size_t at(std::size_t cycle, std::size_t place = 0) {
  return kHdl64eCycleBytes * cycle + place;
}

std::span<const std::uint8_t, kLaserBytes> laser_bytes(Hdl64eTable table, std::size_t laser) {
  return std::span<const std::uint8_t, kLaserBytes>(table.data() + at(hdl64e_laser_cycle(laser)),
                                                    kLaserBytes);
}

bool in_range(const LaserCalibration& laser, const CalibrationField& field) {
  const double value = laser.*field.target;
  return value >= field.lowest && value <= field.highest;
}

bool is_focus(const CalibrationField& field) {
  return field.target == &LaserCalibration::focal_distance_m ||
         field.target == &LaserCalibration::focal_slope;
}

std::optional<LaserCalibration> decode_laser(std::span<const std::uint8_t, kLaserBytes> bytes) {
  LaserCalibration laser;
  for (std::size_t word = 0; word < kWordsPerLaser; ++word) {
    const auto steps = static_cast<std::int16_t>(load_le16(bytes.data() + 1 + 2 * word));
    laser.*kWords[word].target = steps * kWords[word].step;
  }
  bool focus_known = true;
  for (const CalibrationField& field : kCalibrationFields) {
    if (in_range(laser, field)) continue;
    if (!is_focus(field)) return std::nullopt;
    focus_known = false;
  }
  if (!focus_known) laser.focal_distance_m = laser.focal_slope = 0.0;
  const std::uint8_t lowest = bytes[kLaserBytes - 2];
  const std::uint8_t highest = bytes[kLaserBytes - 1];
  if (lowest <= highest) {
    laser.min_intensity = lowest;
    laser.max_intensity = highest;
  }
  return laser;
}

bool encode_laser(const LaserCalibration& laser, std::size_t id, std::uint8_t* bytes) {
  bytes[0] = static_cast<std::uint8_t>(id);
  for (std::size_t word = 0; word < kWordsPerLaser; ++word) {
    const double steps = std::round(laser.*kWords[word].target / kWords[word].step);
    using Limits = std::numeric_limits<std::int16_t>;
    if (!(steps >= Limits::min() && steps <= Limits::max())) return false;
    store_le16(bytes + 1 + 2 * word, static_cast<std::uint16_t>(static_cast<std::int16_t>(steps)));
  }
  bytes[kLaserBytes - 2] = laser.min_intensity;
  bytes[kLaserBytes - 1] = laser.max_intensity;
  return true;
}

std::uint32_t load_address(const std::uint8_t* p) {
  return std::uint32_t{p[0]} << 24 | std::uint32_t{p[1]} << 16 | std::uint32_t{p[2]} << 8 | p[3];
}

void store_address(std::uint8_t* p, std::uint32_t address) {
  for (int i = 0; i < 4; ++i) p[i] = static_cast<std::uint8_t>(address >> (24 - 8 * i));
}

void encode_unit(const Hdl64eUnit& unit, std::uint8_t* table) {
  std::copy(kHdl64eMarker.begin(), kHdl64eMarker.end(), table);
  table[at(0, 5)] = unit.upper_threshold;
  table[at(0, 6)] = unit.lower_threshold;
  if (unit.calibrated) {
    const auto date = hdl64e_time_bytes(unit.calibrated);
    std::copy(date.begin(), date.end(), table + at(kDateCycle));
  }
  table[at(kDateCycle, 6)] = unit.humidity_percent;
  store_le16(table + at(kMotorCycle), static_cast<std::uint16_t>(unit.motor_rpm));
  store_le16(table + at(kMotorCycle, 2), unit.field_of_view_start);
  store_le16(table + at(kMotorCycle, 4), unit.field_of_view_end);
  store_le16(table + at(kMotorCycle, 6), unit.life_hours);
  store_address(table + at(kAddressCycle, 1), unit.source_address);
  store_address(table + at(kAddressCycle, 5), unit.destination_address);
  table[at(kLastCycle, 2)] = static_cast<std::uint8_t>(unit.returns);
  table[at(kLastCycle, 4)] = unit.power_level;
}

}  // namespace

std::uint8_t hdl64e_type(std::size_t cycle, std::size_t place) {
  constexpr std::array<std::uint8_t, kHdl64eCycleBytes> kMotorTypes{0xFE, 0xFF, 0xFC, 0xFD, 0xFA, 0xFB, '7'};
  if (cycle == 0 && place == 5) return 0xF7;
  if (cycle == 0 && place == 6) return 0xF6;
  if (hdl64e_is_warning_cycle(cycle) && place == 0) return 'W';
  if (cycle == kMotorCycle) return kMotorTypes[place];
  if (cycle == kLastCycle && place == 2) return 0xF9;
  if (cycle == kLastCycle && place == 4) return 0xF8;
  return static_cast<std::uint8_t>('1' + place);
}

std::optional<std::size_t> hdl64e_laser_of_cycle(std::size_t cycle) {
  if (cycle % 4 != 1 || cycle >= kDateCycle) return std::nullopt;
  return cycle / 4;
}

bool hdl64e_is_warning_cycle(std::size_t cycle) { return cycle > 0 && cycle < kDateCycle && cycle % 4 == 0; }

std::optional<core::Time> hdl64e_time(std::span<const std::uint8_t, 6> bytes) {
  const std::chrono::year_month_day date{std::chrono::year{2000 + bytes[0]}, std::chrono::month{bytes[1]},
                                         std::chrono::day{bytes[2]}};
  if (!date.ok() || bytes[3] > 23 || bytes[4] > 59 || bytes[5] > 59) return std::nullopt;
  const std::int64_t days = std::chrono::sys_days{date}.time_since_epoch().count();
  return core::Time{(days * 86'400 + (bytes[3] * 60 + bytes[4]) * 60 + bytes[5]) * kNanosecondsPerSecond};
}

std::array<std::uint8_t, 6> hdl64e_time_bytes(std::optional<core::Time> time) {
  using namespace std::chrono;
  const sys_seconds point{floor<seconds>(nanoseconds{time ? time->ns : 0})};
  const sys_days day = floor<days>(point);
  const year_month_day date{day};
  const int year = static_cast<int>(date.year()) - 2000;
  if (!time || year < 0 || year > 255) return {0, 1, 1, 0, 0, 0};
  const hh_mm_ss clock{point - day};
  return {static_cast<std::uint8_t>(year),
          static_cast<std::uint8_t>(static_cast<unsigned>(date.month())),
          static_cast<std::uint8_t>(static_cast<unsigned>(date.day())),
          static_cast<std::uint8_t>(clock.hours().count()),
          static_cast<std::uint8_t>(clock.minutes().count()),
          static_cast<std::uint8_t>(clock.seconds().count())};
}

std::optional<std::array<LaserCalibration, kHdl64eLasers>> hdl64e_lasers(Hdl64eTable table) {
  std::array<LaserCalibration, kHdl64eLasers> lasers;
  for (std::size_t id = 0; id < kHdl64eLasers; ++id) {
    const std::optional<LaserCalibration> laser = decode_laser(laser_bytes(table, id));
    if (!laser) return std::nullopt;
    lasers[id] = *laser;
  }
  return lasers;
}

Hdl64eUnit hdl64e_unit(Hdl64eTable table) {
  const std::uint8_t* p = table.data();
  const std::uint8_t returns = p[at(kLastCycle, 2)];
  return {.upper_threshold = p[at(0, 5)],
          .lower_threshold = p[at(0, 6)],
          .calibrated = hdl64e_time(std::span<const std::uint8_t, 6>(p + at(kDateCycle), 6)),
          .humidity_percent = p[at(kDateCycle, 6)],
          .motor_rpm = static_cast<std::int16_t>(load_le16(p + at(kMotorCycle))),
          .field_of_view_start = load_le16(p + at(kMotorCycle, 2)),
          .field_of_view_end = load_le16(p + at(kMotorCycle, 4)),
          .life_hours = load_le16(p + at(kMotorCycle, 6)),
          .source_address = load_address(p + at(kAddressCycle, 1)),
          .destination_address = load_address(p + at(kAddressCycle, 5)),
          .returns = returns <= 2 ? static_cast<Hdl64eReturn>(returns) : Hdl64eReturn::kUnknown,
          .power_level = p[at(kLastCycle, 4)]};
}

std::uint16_t hdl64e_crc(std::span<const std::uint8_t> bytes) {
  constexpr unsigned kPolynomial = 0x8005;
  unsigned remainder = 0;
  for (const std::uint8_t byte : bytes) {
    remainder ^= static_cast<unsigned>(byte) << 8;
    for (int bit = 0; bit < 8; ++bit) {
      remainder = (remainder << 1) ^ ((remainder & 0x8000U) != 0 ? kPolynomial : 0U);
    }
    remainder &= 0xFFFFU;
  }
  return static_cast<std::uint16_t>(remainder);
}

std::uint16_t hdl64e_sent_crc(Hdl64eTable table) { return load_le16(table.data() + at(kLastCycle, 5)); }

std::uint16_t hdl64e_computed_crc(Hdl64eTable table, Hdl64eCrcOrder order) {
  constexpr std::size_t kCovered = kLaserBytes - 1;
  std::array<std::uint8_t, kHdl64eLasers * kCovered> bytes{};
  for (std::size_t id = 0; id < kHdl64eLasers; ++id) {
    std::uint8_t* const covered = bytes.data() + id * kCovered;
    const auto laser = laser_bytes(table, id);
    std::copy(laser.begin() + 1, laser.end(), covered);
    if (order == Hdl64eCrcOrder::kStream) continue;
    for (std::size_t word = 0; word < kWordsPerLaser; ++word) {
      std::swap(covered[2 * word], covered[2 * word + 1]);
    }
  }
  return hdl64e_crc(bytes);
}

core::Result<std::array<std::uint8_t, kHdl64eTableSize>> hdl64e_make_table(
    std::span<const LaserCalibration, kHdl64eLasers> lasers, const Hdl64eUnit& unit,
    Hdl64eChecksum checksum) {
  std::array<std::uint8_t, kHdl64eTableSize> table{};
  for (std::size_t id = 0; id < kHdl64eLasers; ++id) {
    if (encode_laser(lasers[id], id, table.data() + at(hdl64e_laser_cycle(id)))) continue;
    return core::Error{"HDL-64E status stream: a value of laser " + std::to_string(id) +
                       " does not fit (16 bits of 0.01 degree, 1 mm, slope 0.1); check the calibration"};
  }
  encode_unit(unit, table.data());
  const std::uint16_t crc =
      checksum == Hdl64eChecksum::kNone ? kHdl64eNoCrc : hdl64e_computed_crc(table, Hdl64eCrcOrder::kManual);
  store_le16(table.data() + at(kLastCycle, 5), crc);
  return table;
}

}  // namespace nilio::drivers
