#pragma once

#include "nilio/drivers/can/dbc/dbc.hpp"
#include "nilio/drivers/imu/decoder.hpp"

#include <algorithm>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

namespace nilio::tests {

/// Why a DBC file of this content is refused.
inline std::string dbc_error(const std::string& text) {
  const auto database = drivers::parse_dbc(text, "t.dbc");
  REQUIRE_FALSE(database.ok());
  return database.error().message;
}

inline drivers::ImuPreset preset_of(std::string_view name) {
  auto preset = drivers::imu_preset(name);
  REQUIRE(preset.ok());
  return *preset;
}

inline drivers::ImuDecoder decoder_of(const drivers::ImuPreset& preset) {
  auto decoder = drivers::ImuDecoder::create(preset.mapping, preset.database);
  REQUIRE(decoder.ok());
  return std::move(decoder).value();
}

inline drivers::CanFrame frame_of(std::uint32_t id, const std::vector<std::uint8_t>& data,
                                  std::int64_t stamp_ns) {
  drivers::CanFrame frame;
  frame.stamp.ns = stamp_ns;
  frame.id = id;
  frame.length = static_cast<std::uint8_t>(data.size());
  std::copy(data.begin(), data.end(), frame.data.begin());
  return frame;
}

inline std::vector<std::uint8_t> bytes_of(const drivers::CanFrame& frame) {
  return {frame.data.begin(), frame.data.begin() + frame.length};
}

/// The low bytes of a number, last byte first.
inline std::vector<std::uint8_t> big_endian(std::uint64_t value, std::size_t size) {
  std::vector<std::uint8_t> bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[size - 1 - i] = static_cast<std::uint8_t>(value >> (8 * i));
  return bytes;
}

inline std::vector<std::uint8_t> little_endian(std::uint64_t value, std::size_t size) {
  std::vector<std::uint8_t> bytes = big_endian(value, size);
  std::reverse(bytes.begin(), bytes.end());
  return bytes;
}

}  // namespace nilio::tests
