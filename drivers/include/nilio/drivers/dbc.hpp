#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::drivers {

/// What the raw bits of a signal are (SIG_VALTYPE_).
enum class DbcValueType { kInteger, kFloat32, kFloat64 };

/// One signal of a DBC message: physical = raw * factor + offset.
struct DbcSignal {
  std::string name;
  /// Bit 8 * byte + bit (bit 0 = least significant): of the least significant bit of a little-endian (Intel)
  /// signal, of the most significant bit of a big-endian (Motorola) one.
  std::uint16_t start_bit = 0;
  std::uint16_t length = 0;
  bool little_endian = true;
  bool is_signed = false;
  DbcValueType value_type = DbcValueType::kInteger;
  /// Present only in the frames that a multiplexer signal selects. Which ones is not kept.
  bool multiplexed = false;
  double factor = 1.0;
  double offset = 0.0;
  double minimum = 0.0;
  double maximum = 0.0;
  std::string unit;
};

struct DbcMessage {
  std::uint32_t id = 0;
  bool extended = false;
  std::string name;
  std::uint16_t length = 0;
  std::vector<DbcSignal> signals;
};

struct DbcDatabase {
  std::string path;
  std::vector<DbcMessage> messages;

  [[nodiscard]] const DbcMessage* find(std::string_view message_name) const;
  [[nodiscard]] const DbcSignal* find(std::string_view message_name, std::string_view signal_name) const;
};

/// Messages, signals and value types are read; every other statement is passed over. Errors name file, line
/// and token. `path` is only for messages in parse_dbc.
core::Result<DbcDatabase> parse_dbc(std::string_view text, const std::string& path);
core::Result<DbcDatabase> load_dbc(const std::string& path);

/// Bytes a payload must have to hold the signal.
std::size_t required_length(const DbcSignal& signal);

/// Nothing when the payload is too short for the signal. Exact to the DBC's bit numbering. An unsigned signal
/// of 64 bits comes as the two's complement of the same bits, a floating-point signal as its bit pattern.
std::optional<std::int64_t> decode_raw(const DbcSignal& signal, std::span<const std::uint8_t> data);
std::optional<double> decode_physical(const DbcSignal& signal, std::span<const std::uint8_t> data);
/// Rounds to the nearest raw value and saturates at what the raw bits can hold; false when the payload is too
/// short, the value is not a number or the factor is zero. Other bits of the payload are kept.
bool encode_physical(const DbcSignal& signal, double physical, std::span<std::uint8_t> data);

}  // namespace nilio::drivers
