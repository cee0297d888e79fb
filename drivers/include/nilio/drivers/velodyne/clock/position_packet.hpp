#pragma once

#include "nilio/drivers/velodyne/model.hpp"

#include <array>
#include <cstdint>
#include <numbers>
#include <optional>
#include <span>
#include <string_view>

namespace nilio::drivers {

inline constexpr std::size_t kNmeaCapacity = 128;

/// State of the sensor's clock against the pulse per second of a GPS receiver.
enum class PpsState : std::uint8_t {
  kAbsent = 0,
  kSynchronising = 1,
  kLocked = 2,
  kError = 3,
  /// Another value, or a firmware that does not fill this field: state and temperatures are all zero then.
  kUnknown = 255,
};

/// Magnitudes from which on a motion field is at its limit, rad/s and m/s^2.
inline constexpr double kHdl32eGyroRange = 2046.5 * 0.09766 * std::numbers::pi / 180.0;
inline constexpr double kHdl32eAccelerationRange = 2046.5 * 0.001221 * 9.80665;

/// One of the three boards in an HDL-32E's fixed base, with a gyro, a thermometer and a two-axis
/// accelerometer. X of boards 0 and 1 points up (along the spin axis); Y of board 0 is opposite to X of board
/// 2; Y of boards 1 and 2 are parallel. motion_of() gives the LiDAR's axes.
struct Hdl32eBoard {
  double gyro_rad_s = 0.0;
  double temperature_degc = 0.0;
  double acceleration_x_m_s2 = 0.0;
  double acceleration_y_m_s2 = 0.0;

  friend bool operator==(const Hdl32eBoard&, const Hdl32eBoard&) = default;
};

/// Temperatures and self-calibration that newer firmware reports (VLP-32C manual 63-9325, "position packet").
struct SensorHealth {
  std::uint8_t top_board_degc = 0;
  std::uint8_t bottom_board_degc = 0;
  std::uint8_t adc_calibration_degc = 0;
  /// Change since the last calibration of the converters.
  std::int16_t temperature_change_degc = 0;
  std::uint32_t adc_calibration_age_s = 0;
  std::uint8_t adc_calibration_reason = 0;
  /// Bit 0 in progress, bit 1 temperature limit met, bit 2 period elapsed.
  std::uint8_t adc_calibration_status = 0;
  /// 0 = good, 1 = shut down.
  std::uint8_t thermal_status = 0;
  std::uint8_t last_shutdown_degc = 0;
  std::uint8_t power_up_degc = 0;

  friend bool operator==(const SensorHealth&, const SensorHealth&) = default;
};

/// A telemetry packet (UDP port 8308).
struct PositionPacket {
  /// Microseconds past the hour, the clock of the data packets.
  std::uint32_t timestamp_us = 0;
  PpsState pps = PpsState::kUnknown;
  SensorHealth health;
  /// HDL-32E only.
  std::optional<std::array<Hdl32eBoard, 3>> motion;
  /// The receiver's latest sentence, with line end, zero padded; nmea() is the text. Unchecked bytes: see
  /// parse_nmea().
  std::array<char, kNmeaCapacity> nmea_bytes{};

  [[nodiscard]] std::string_view nmea() const;
  /// Cuts beyond kNmeaCapacity bytes.
  void set_nmea(std::string_view sentence);

  friend bool operator==(const PositionPacket&, const PositionPacket&) = default;
};

/// Returns nothing unless the payload has exactly 512 bytes. Thread-safe, does not allocate.
std::optional<PositionPacket> parse_position_packet(std::span<const std::uint8_t> payload);

/// The inverse of parse_position_packet(): parsing the result gives `packet` again, with motion rounded to
/// the field's steps and limited to its range. PpsState::kAbsent needs a nonzero temperature; otherwise it is
/// read as kUnknown.
std::array<std::uint8_t, kPositionPacketSize> encode_position_packet(const PositionPacket& packet);

}  // namespace nilio::drivers
