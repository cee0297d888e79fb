#include "nilio/drivers/velodyne/clock/position_packet.hpp"

#include "drivers/common/byte_order.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nilio::drivers {
namespace {

constexpr std::size_t kMotionOffset = 14;
constexpr std::size_t kBoardSize = 8;
constexpr std::size_t kHealthOffset = 0xBB;
constexpr std::size_t kPositionTimestampOffset = 0xC6;
constexpr std::size_t kPpsOffset = 0xCA;
constexpr std::size_t kNmeaOffset = 0xCE;

/// Scale of a motion field (HDL-32E manual, "positioning packet"): 12-bit numbers. Recordings have 0, 1, 2, 3
/// in the upper four bits of a board's gyro, temperature and accelerations, unlike the zeros of other
/// sensors.
struct MotionScale {
  double unit = 0.0;
  double zero = 0.0;
};
constexpr double kStandardGravity = 9.80665;
constexpr MotionScale kGyro{0.09766 * std::numbers::pi / 180.0, 0.0};
constexpr MotionScale kTemperature{0.1453, 25.0};
constexpr MotionScale kAcceleration{0.001221 * kStandardGravity, 0.0};

double load_motion(const std::uint8_t* p, MotionScale scale) {
  const int bits = load_le16(p) & 0x0FFF;
  return scale.unit * (bits >= 0x0800 ? bits - 0x1000 : bits) + scale.zero;
}

void store_motion(std::uint8_t* p, unsigned tag, MotionScale scale, double value) {
  const double steps = std::clamp(std::round((value - scale.zero) / scale.unit), -2048.0, 2047.0);
  const auto bits = static_cast<unsigned>(static_cast<int>(steps)) & 0x0FFFU;
  store_le16(p, static_cast<std::uint16_t>((tag << 12) | bits));
}

bool has_motion(const std::uint8_t* words) {
  for (std::size_t word = 0; word < 12; ++word) {
    if (load_le16(words + 2 * word) >> 12 != static_cast<int>(word % 4)) return false;
  }
  return true;
}

std::optional<std::array<Hdl32eBoard, 3>> load_boards(const std::uint8_t* words) {
  if (!has_motion(words)) return std::nullopt;
  std::array<Hdl32eBoard, 3> boards;
  for (Hdl32eBoard& board : boards) {
    board.gyro_rad_s = load_motion(words, kGyro);
    board.temperature_degc = load_motion(words + 2, kTemperature);
    board.acceleration_x_m_s2 = load_motion(words + 4, kAcceleration);
    board.acceleration_y_m_s2 = load_motion(words + 6, kAcceleration);
    words += kBoardSize;
  }
  return boards;
}

void store_boards(std::uint8_t* words, const std::array<Hdl32eBoard, 3>& boards) {
  for (const Hdl32eBoard& board : boards) {
    store_motion(words, 0, kGyro, board.gyro_rad_s);
    store_motion(words + 2, 1, kTemperature, board.temperature_degc);
    store_motion(words + 4, 2, kAcceleration, board.acceleration_x_m_s2);
    store_motion(words + 6, 3, kAcceleration, board.acceleration_y_m_s2);
    words += kBoardSize;
  }
}

SensorHealth load_health(const std::uint8_t* packet) {
  const std::uint8_t* p = packet + kHealthOffset;
  const std::uint8_t* after_pps = packet + kPpsOffset + 1;
  return {.top_board_degc = p[0],
          .bottom_board_degc = p[1],
          .adc_calibration_degc = p[2],
          .temperature_change_degc = static_cast<std::int16_t>(load_le16(p + 3)),
          .adc_calibration_age_s = load_le32(p + 5),
          .adc_calibration_reason = p[9],
          .adc_calibration_status = p[10],
          .thermal_status = after_pps[0],
          .last_shutdown_degc = after_pps[1],
          .power_up_degc = after_pps[2]};
}

void store_health(std::uint8_t* packet, const SensorHealth& health) {
  std::uint8_t* p = packet + kHealthOffset;
  p[0] = health.top_board_degc;
  p[1] = health.bottom_board_degc;
  p[2] = health.adc_calibration_degc;
  store_le16(p + 3, static_cast<std::uint16_t>(health.temperature_change_degc));
  store_le32(p + 5, health.adc_calibration_age_s);
  p[9] = health.adc_calibration_reason;
  p[10] = health.adc_calibration_status;
  std::uint8_t* after_pps = packet + kPpsOffset + 1;
  after_pps[0] = health.thermal_status;
  after_pps[1] = health.last_shutdown_degc;
  after_pps[2] = health.power_up_degc;
}

PpsState to_pps(std::uint8_t value, const SensorHealth& health) {
  if (value > static_cast<std::uint8_t>(PpsState::kError)) return PpsState::kUnknown;
  if (value == 0 && health == SensorHealth{}) return PpsState::kUnknown;
  return static_cast<PpsState>(value);
}

std::uint8_t from_pps(PpsState state, const SensorHealth& health) {
  if (state == PpsState::kUnknown && health == SensorHealth{}) return 0;
  return static_cast<std::uint8_t>(state);
}

}  // namespace

std::string_view PositionPacket::nmea() const {
  const auto* const end = std::find(nmea_bytes.begin(), nmea_bytes.end(), '\0');
  return {nmea_bytes.data(), static_cast<std::size_t>(end - nmea_bytes.begin())};
}

void PositionPacket::set_nmea(std::string_view sentence) {
  nmea_bytes.fill('\0');
  std::copy_n(sentence.begin(), std::min(sentence.size(), kNmeaCapacity), nmea_bytes.begin());
}

std::optional<PositionPacket> parse_position_packet(std::span<const std::uint8_t> payload) {
  if (payload.size() != kPositionPacketSize) return std::nullopt;
  const std::uint8_t* p = payload.data();
  PositionPacket packet;
  packet.timestamp_us = load_le32(p + kPositionTimestampOffset);
  packet.health = load_health(p);
  packet.pps = to_pps(p[kPpsOffset], packet.health);
  packet.motion = load_boards(p + kMotionOffset);
  const auto text = payload.subspan(kNmeaOffset, kNmeaCapacity);
  const auto end = std::find(text.begin(), text.end(), std::uint8_t{0});
  std::transform(text.begin(), end, packet.nmea_bytes.begin(),
                 [](std::uint8_t byte) { return static_cast<char>(byte); });
  return packet;
}

std::array<std::uint8_t, kPositionPacketSize> encode_position_packet(const PositionPacket& packet) {
  std::array<std::uint8_t, kPositionPacketSize> bytes{};
  store_le32(bytes.data() + kPositionTimestampOffset, packet.timestamp_us);
  store_health(bytes.data(), packet.health);
  bytes[kPpsOffset] = from_pps(packet.pps, packet.health);
  if (packet.motion) store_boards(bytes.data() + kMotionOffset, *packet.motion);
  const std::string_view text = packet.nmea();
  std::transform(text.begin(), text.end(), bytes.begin() + kNmeaOffset,
                 [](char c) { return static_cast<std::uint8_t>(c); });
  return bytes;
}

}  // namespace nilio::drivers
