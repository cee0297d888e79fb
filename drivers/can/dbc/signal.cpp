#include "nilio/drivers/can/dbc/dbc.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace nilio::drivers {
namespace {

constexpr unsigned low_mask(unsigned bits) { return (1U << bits) - 1U; }

/// Position of a Motorola signal's most significant bit in transmission order.
unsigned network_position(const DbcSignal& signal) {
  return 8U * (signal.start_bit / 8U) + 7U - signal.start_bit % 8U;
}

std::uint64_t gather_little_endian(const DbcSignal& signal, std::span<const std::uint8_t> data) {
  std::uint64_t value = 0;
  unsigned bit = signal.start_bit;
  for (unsigned filled = 0; filled < signal.length;) {
    const unsigned take = std::min(8U - bit % 8U, signal.length - filled);
    value |= static_cast<std::uint64_t>((data[bit / 8U] >> (bit % 8U)) & low_mask(take)) << filled;
    filled += take;
    bit += take;
  }
  return value;
}

std::uint64_t gather_big_endian(const DbcSignal& signal, std::span<const std::uint8_t> data) {
  std::uint64_t value = 0;
  unsigned position = network_position(signal);
  for (unsigned remaining = signal.length; remaining > 0;) {
    const unsigned take = std::min(8U - position % 8U, remaining);
    const unsigned shift = 8U - position % 8U - take;
    value = (value << take) | ((data[position / 8U] >> shift) & low_mask(take));
    remaining -= take;
    position += take;
  }
  return value;
}

void set_bits(std::uint8_t& byte, unsigned shift, unsigned count, std::uint64_t bits) {
  const unsigned mask = low_mask(count) << shift;
  const unsigned shifted = static_cast<unsigned>(bits & low_mask(count)) << shift;
  byte = static_cast<std::uint8_t>((byte & ~mask) | shifted);
}

void scatter(const DbcSignal& signal, std::uint64_t value, std::span<std::uint8_t> data) {
  if (signal.little_endian) {
    unsigned bit = signal.start_bit;
    for (unsigned written = 0; written < signal.length;) {
      const unsigned take = std::min(8U - bit % 8U, signal.length - written);
      set_bits(data[bit / 8U], bit % 8U, take, value >> written);
      written += take;
      bit += take;
    }
    return;
  }
  unsigned position = network_position(signal);
  for (unsigned remaining = signal.length; remaining > 0;) {
    const unsigned take = std::min(8U - position % 8U, remaining);
    remaining -= take;
    set_bits(data[position / 8U], 8U - position % 8U - take, take, value >> remaining);
    position += take;
  }
}

/// Nearest raw integer, saturated; the limits are compared as doubles, which cannot hold 2^63 - 1 exactly.
std::uint64_t saturated_raw(const DbcSignal& signal, double raw) {
  const int value_bits = signal.length - (signal.is_signed ? 1 : 0);
  const double limit = std::ldexp(1.0, value_bits);
  const std::uint64_t largest =
      value_bits >= 64 ? std::numeric_limits<std::uint64_t>::max() : (1ULL << value_bits) - 1ULL;
  const double rounded = std::nearbyint(raw);
  if (rounded >= limit) return largest;
  if (signal.is_signed) {
    if (rounded < -limit) return static_cast<std::uint64_t>(-static_cast<std::int64_t>(largest) - 1);
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(rounded));
  }
  return rounded <= 0.0 ? 0U : static_cast<std::uint64_t>(rounded);
}

}  // namespace

std::size_t required_length(const DbcSignal& signal) {
  const unsigned first = signal.little_endian ? signal.start_bit : network_position(signal);
  return (first + signal.length + 7U) / 8U;
}

bool is_selected(const DbcMessage& message, const DbcSignal& signal, std::span<const std::uint8_t> data) {
  const DbcSignal* selected = &signal;
  // The number of steps is limited: in a database not made by parse_dbc() selectors may form a cycle.
  for (std::size_t step = 0; step <= message.signals.size(); ++step) {
    if (!selected->multiplexed) return true;
    if (!selected->selector || *selected->selector >= message.signals.size()) return false;
    const DbcSignal& selector = message.signals[*selected->selector];
    const std::optional<std::int64_t> raw = decode_raw(selector, data);
    if (!raw) return false;
    const auto value = static_cast<std::uint64_t>(*raw);
    const bool matches =
        std::any_of(selected->selected_by.begin(), selected->selected_by.end(),
                    [value](const DbcRange& r) { return r.first <= value && value <= r.last; });
    if (!matches) return false;
    selected = &selector;
  }
  return false;
}

std::optional<double> decode_physical(const DbcMessage& message, const DbcSignal& signal,
                                      std::span<const std::uint8_t> data) {
  return is_selected(message, signal, data) ? decode_physical(signal, data) : std::nullopt;
}

std::optional<std::int64_t> decode_raw(const DbcSignal& signal, std::span<const std::uint8_t> data) {
  if (signal.length == 0 || signal.length > 64 || data.size() < required_length(signal)) return std::nullopt;
  std::uint64_t value =
      signal.little_endian ? gather_little_endian(signal, data) : gather_big_endian(signal, data);
  const bool negative = signal.is_signed && ((value >> (signal.length - 1U)) & 1U) != 0;
  if (negative && signal.length < 64) value |= ~0ULL << signal.length;
  return static_cast<std::int64_t>(value);
}

std::optional<double> decode_physical(const DbcSignal& signal, std::span<const std::uint8_t> data) {
  const std::optional<std::int64_t> raw = decode_raw(signal, data);
  if (!raw) return std::nullopt;
  double value = 0.0;
  switch (signal.value_type) {
    case DbcValueType::kFloat32:
      value = static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(*raw)));
      break;
    case DbcValueType::kFloat64:
      value = std::bit_cast<double>(*raw);
      break;
    case DbcValueType::kInteger:
      value = signal.is_signed ? static_cast<double>(*raw)
                               : static_cast<double>(static_cast<std::uint64_t>(*raw));
      break;
  }
  return value * signal.factor + signal.offset;
}

bool encode_physical(const DbcSignal& signal, double physical, std::span<std::uint8_t> data) {
  if (signal.length == 0 || signal.length > 64 || data.size() < required_length(signal)) return false;
  const double raw = (physical - signal.offset) / signal.factor;
  if (std::isnan(raw) || signal.factor == 0.0) return false;
  switch (signal.value_type) {
    case DbcValueType::kFloat32:
      scatter(signal, std::bit_cast<std::uint32_t>(static_cast<float>(raw)), data);
      break;
    case DbcValueType::kFloat64:
      scatter(signal, std::bit_cast<std::uint64_t>(raw), data);
      break;
    case DbcValueType::kInteger:
      scatter(signal, saturated_raw(signal, raw), data);
      break;
  }
  return true;
}

}  // namespace nilio::drivers
