#include "drivers/velodyne/packet_shape.hpp"

#include "drivers/common/little_endian.hpp"
#include "drivers/velodyne/layout.hpp"

#include <array>

namespace nilio::drivers {
namespace {

std::uint16_t flag_of(std::span<const std::uint8_t> payload, std::size_t block) {
  return load_u16(payload.data() + block * kBlockSize);
}

std::uint16_t azimuth_of(std::span<const std::uint8_t> payload, std::size_t block) {
  return load_u16(payload.data() + block * kBlockSize + kAzimuthOffset);
}

bool repeats(std::span<const std::uint8_t> payload, std::span<const std::uint16_t> flags) {
  for (std::size_t b = 0; b < kBlocksPerPacket; ++b) {
    const std::uint16_t expected = flags[b % flags.size()];
    // 0 = any: padding.
    if (expected != 0 && flag_of(payload, b) != expected) return false;
  }
  return true;
}

constexpr std::array<std::uint16_t, 1> kUpper{0xEEFF};
constexpr std::array<std::uint16_t, 2> kTwoBanks{0xEEFF, 0xDDFF};
constexpr std::array<std::uint16_t, 4> kFourBanks{0xEEFF, 0xDDFF, 0xCCFF, 0xBBFF};
constexpr std::array<std::uint16_t, 12> kTwice{0xEEFF, 0xEEFF, 0xDDFF, 0xDDFF, 0xCCFF, 0xCCFF,
                                               0xBBFF, 0xBBFF, 0,      0,      0,      0};
constexpr std::array<std::uint16_t, 12> kThrice{0xEEFF, 0xEEFF, 0, 0xDDFF, 0xDDFF, 0,
                                                0xCCFF, 0xCCFF, 0, 0xBBFF, 0xBBFF, 0};

std::optional<ReturnMode> mode_of_byte(std::uint8_t byte) {
  switch (byte) {
    case 0x37:
    case 0x38:
      return ReturnMode::kSingle;
    case 0x39:
      return ReturnMode::kDual;
    case 0x3B:
      return ReturnMode::kDualConfidence;
    default:
      return std::nullopt;
  }
}

}  // namespace

PacketShape packet_shape(std::span<const std::uint8_t> payload) {
  if (repeats(payload, kUpper)) return PacketShape::kUpperOnly;
  if (repeats(payload, kFourBanks)) return PacketShape::kFourBanks;
  if (repeats(payload, kTwoBanks)) return PacketShape::kAlternating;
  if (repeats(payload, kTwice)) return PacketShape::kFourBanksTwice;
  if (repeats(payload, kThrice)) return PacketShape::kFourBanksThrice;
  return PacketShape::kOther;
}

std::optional<bool> azimuths_in_pairs(std::span<const std::uint8_t> payload, std::size_t blocks_per_return) {
  bool all_equal = true;
  bool paired = true;
  for (std::size_t b = 0; b + blocks_per_return < kBlocksPerPacket; b += 2 * blocks_per_return) {
    paired = paired && azimuth_of(payload, b) == azimuth_of(payload, b + blocks_per_return);
    all_equal = all_equal && azimuth_of(payload, b) == azimuth_of(payload, 0);
  }
  if (paired && all_equal) return std::nullopt;
  return paired;
}

std::optional<ReturnMode> return_mode_of(std::span<const std::uint8_t> payload,
                                         const VelodyneSensor& sensor) {
  const std::size_t banks = (sensor.lasers.size() + kEntriesPerBlock - 1) / kEntriesPerBlock;
  if (banks == 4) {
    const PacketShape shape = packet_shape(payload);
    if (shape == PacketShape::kFourBanks) return ReturnMode::kSingle;
    if (shape == PacketShape::kFourBanksTwice) return ReturnMode::kDual;
    if (shape == PacketShape::kFourBanksThrice) return ReturnMode::kDualConfidence;
    return std::nullopt;
  }
  // Early firmware has anything in these bytes; then the other one is wrong, too.
  if (sensor.product_byte != 0 && payload[kProductOffset] == sensor.product_byte) {
    if (const std::optional<ReturnMode> mode = mode_of_byte(payload[kReturnModeOffset])) return mode;
  }
  const std::optional<bool> pairs = azimuths_in_pairs(payload, banks);
  if (!pairs) return std::nullopt;
  return *pairs ? ReturnMode::kDual : ReturnMode::kSingle;
}

}  // namespace nilio::drivers
