#pragma once

#include "nilio/drivers/velodyne/model.hpp"

#include <cstdint>
#include <optional>
#include <span>

namespace nilio::drivers {

/// Offsets in a data packet (any Velodyne manual, "data packet structure").
inline constexpr std::size_t kBlockSize = 100;
inline constexpr std::size_t kAzimuthOffset = 2;
inline constexpr std::size_t kEntriesOffset = 4;
inline constexpr std::size_t kEntrySize = 3;
inline constexpr std::size_t kTimestampOffset = 1200;
inline constexpr std::size_t kReturnModeOffset = 1204;
inline constexpr std::size_t kProductOffset = 1205;

/// Pattern of the flags of a data packet's blocks.
enum class PacketShape {
  kUpperOnly,    ///< 16 or 32 lasers
  kAlternating,  ///< HDL-64E, one return
  kFourBanks,    ///< VLS-128, one return
  kFourBanksTwice,
  kFourBanksThrice,
  kOther,
};

/// `payload` has kDataPacketSize bytes.
PacketShape packet_shape(std::span<const std::uint8_t> payload);

/// True when every second block repeats the azimuth of the block before, the sign of two returns. Empty
/// when all azimuths are equal, as with a stopped motor.
std::optional<bool> azimuths_in_pairs(std::span<const std::uint8_t> payload, std::size_t blocks_per_return);

/// Number that differs between packets and is equal for copies of one; never 0. `payload` has
/// kDataPacketSize bytes.
std::uint64_t payload_key(std::span<const std::uint8_t> payload);

/// Return mode of a packet of this sensor: by its factory byte where that is reliable, otherwise by its
/// shape; nothing when neither shows it.
std::optional<ReturnMode> return_mode_of(std::span<const std::uint8_t> payload, const VelodyneSensor& sensor);

}  // namespace nilio::drivers
