#pragma once

#include "nilio/drivers/velodyne/model.hpp"

#include <cstdint>
#include <optional>
#include <span>

namespace nilio::drivers {

/// What the flags of a data packet's blocks look like.
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

/// Whether the second block repeats the first one's azimuth and so on: two returns, unless the motor stands
/// (nothing).
std::optional<bool> azimuths_in_pairs(std::span<const std::uint8_t> payload, std::size_t blocks_per_return);

/// Return mode of a packet of this sensor, by its factory byte, or by its shape where it has none that can be
/// trusted; nothing when it cannot be told.
std::optional<ReturnMode> return_mode_of(std::span<const std::uint8_t> payload, const VelodyneSensor& sensor);

}  // namespace nilio::drivers
