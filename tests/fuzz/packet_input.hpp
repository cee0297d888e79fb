#pragma once

#include <cstdint>

namespace nilio::fuzz {

/// Format of fuzz_packets' input: model, time source, return mode, returns, cut azimuth (in 360/256 degree),
/// minimum coverage (in 1/256), one byte each, then records that begin with one of these.
enum class PacketRecord : std::uint8_t {
  /// u16 stamp advance (us), u16 length, payload of this length.
  kRaw = 0,
  /// u8 count, u16 azimuth advance per step (0.01 degree), i16 clock error per packet (us): `count`
  /// good packets of a turning sensor.
  kTurn = 1,
  /// u16 offset, u8 value: the last packet again with this byte changed.
  kAgain = 2,
  /// u32 sensor clock (us past the hour), u32 host clock advance (us).
  kClock = 3,
};

}  // namespace nilio::fuzz
