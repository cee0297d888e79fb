#pragma once

#include "nilio/core/result.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::drivers {

/// Type of a signal's raw bits (SIG_VALTYPE_).
enum class DbcValueType { kInteger, kFloat32, kFloat64 };

/// Range of raw values of a multiplexer, both ends included.
struct DbcRange {
  std::uint64_t first = 0;
  std::uint64_t last = 0;
};

/// Name of a raw value (VAL_).
struct DbcValueName {
  std::int64_t raw = 0;
  std::string name;
};

/// One signal of a DBC message: physical = raw * factor + offset. Texts are UTF-8, whatever the file's
/// encoding.
struct DbcSignal {
  std::string name;
  /// 8 * byte + bit (bit 0 = least significant) of the least significant bit of a little-endian (Intel)
  /// signal, or of the most significant bit of a big-endian (Motorola) signal.
  std::uint16_t start_bit = 0;
  std::uint16_t length = 0;
  bool little_endian = true;
  bool is_signed = false;
  DbcValueType value_type = DbcValueType::kInteger;
  /// Its raw value selects which other signals a frame holds (M, m3M).
  bool multiplexer = false;
  /// Present only in the frames that a multiplexer selects (m3, m3M, SG_MUL_VAL_).
  bool multiplexed = false;
  /// Multiplexer of a multiplexed signal, as index into DbcMessage::signals. Empty when the message has
  /// none: then no frame has the signal.
  std::optional<std::size_t> selector;
  /// Values of the multiplexer that select this signal.
  std::vector<DbcRange> selected_by;
  double factor = 1.0;
  double offset = 0.0;
  /// Physical limits; both zero = none given.
  double minimum = 0.0;
  double maximum = 0.0;
  std::string unit;
  std::vector<DbcValueName> values;
  std::string comment;
};

struct DbcMessage {
  std::uint32_t id = 0;
  bool extended = false;
  std::string name;
  /// Bytes; more than 64 in messages that a transport protocol splits into several frames.
  std::uint16_t length = 0;
  std::vector<DbcSignal> signals;
  /// VFrameFormat is CAN FD.
  bool flexible_data_rate = false;
  /// VFrameFormat is J1939: the identifier's last byte is the sender's address; frames match with any
  /// address.
  bool j1939 = false;
  /// GenMsgCycleTime; 0 = unknown.
  double cycle_ms = 0.0;
  std::string comment;
};

struct DbcDatabase {
  std::string path;
  std::vector<DbcMessage> messages;
  /// Remarks for the user, with line numbers: unused statements and contradictions in the file.
  std::vector<std::string> notes;
  /// Messages, signals and other statements that could not be read and are skipped, each with file, line and
  /// token.
  std::vector<std::string> warnings;

  [[nodiscard]] const DbcMessage* find(std::string_view message_name) const;
  [[nodiscard]] const DbcSignal* find(std::string_view message_name, std::string_view signal_name) const;
};

/// Reads messages, signals, value types, multiplexing, value tables, comments, and the attributes
/// GenMsgCycleTime and VFrameFormat. The notes name unused statements. A message or signal that cannot be
/// read is skipped, with a warning that names file, line, token and the expected token; a file without any
/// usable one is an error. parse_dbc() uses `path` only in messages.
core::Result<DbcDatabase> parse_dbc(std::string_view text, const std::string& path);
core::Result<DbcDatabase> load_dbc(const std::string& path);

/// Smallest payload that holds the signal, bytes.
std::size_t required_length(const DbcSignal& signal);

/// True when the multiplexers above the signal select it in this payload; always true for signals without
/// multiplexer. `signal` is one of the message's.
bool is_selected(const DbcMessage& message, const DbcSignal& signal, std::span<const std::uint8_t> data);
/// As decode_physical(signal, data); also nothing when the signal is not selected in this payload.
std::optional<double> decode_physical(const DbcMessage& message, const DbcSignal& signal,
                                      std::span<const std::uint8_t> data);

/// Raw value of a signal that is in every frame, or is selected in this one. Empty when the payload is too
/// short. An unsigned signal of 64 bits is returned as the two's complement of the same bits, a
/// floating-point signal as its bit pattern.
std::optional<std::int64_t> decode_raw(const DbcSignal& signal, std::span<const std::uint8_t> data);
std::optional<double> decode_physical(const DbcSignal& signal, std::span<const std::uint8_t> data);
/// Rounds to the nearest raw value and saturates at what the raw bits can hold; false when the payload is too
/// short, the value is not a number or the factor is zero. Other bits of the payload are kept.
bool encode_physical(const DbcSignal& signal, double physical, std::span<std::uint8_t> data);

}  // namespace nilio::drivers
