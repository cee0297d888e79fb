#include "drivers/velodyne/packet_bytes.hpp"

#include "nilio/drivers/velodyne/packet.hpp"

#include "drivers/common/byte_order.hpp"

#include <array>

namespace nilio::drivers {
namespace {

std::uint16_t flag_of(std::span<const std::uint8_t> payload, std::size_t block) {
  return load_le16(payload.data() + block * kBlockSize);
}

std::uint16_t azimuth_of(std::span<const std::uint8_t> payload, std::size_t block) {
  return load_le16(payload.data() + block * kBlockSize + kAzimuthOffset);
}

bool repeats(std::span<const std::uint8_t> payload, std::span<const std::uint16_t> flags) {
  for (std::size_t b = 0; b < kBlocksPerPacket; ++b) {
    const std::uint16_t expected = flags[b % flags.size()];
    // 0 = padding with any flag.
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

/// FNV-1a over words of four bytes; the two bytes left are the factory bytes.
std::uint64_t payload_key(std::span<const std::uint8_t> payload) {
  std::uint64_t key = 0xCBF29CE484222325ULL;
  for (std::size_t i = 0; i + 4 <= kDataPacketSize; i += 4)
    key = (key ^ load_le32(payload.data() + i)) * 0x100000001B3ULL;
  key = (key ^ load_le16(payload.data() + kReturnModeOffset)) * 0x100000001B3ULL;
  return key | 1U;
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
  // Early firmware fills both factory bytes at random: a wrong product byte makes the mode byte invalid, too.
  if (sensor.product_byte != 0 && payload[kProductOffset] == sensor.product_byte) {
    if (const std::optional<ReturnMode> mode = mode_of_byte(payload[kReturnModeOffset])) return mode;
  }
  const std::optional<bool> pairs = azimuths_in_pairs(payload, banks);
  if (!pairs) return std::nullopt;
  return *pairs ? ReturnMode::kDual : ReturnMode::kSingle;
}

std::array<std::uint8_t, kDataPacketSize> encode(const VelodyneDataPacket& packet) {
  std::array<std::uint8_t, kDataPacketSize> bytes{};
  for (std::size_t b = 0; b < kBlocksPerPacket; ++b) {
    const VelodyneDataPacket::Block& block = packet.blocks[b];
    std::uint8_t* out = bytes.data() + kBlockSize * b;
    store_le16(out, block.flag);
    store_le16(out + kAzimuthOffset, block.azimuth);
    out += kEntriesOffset;
    for (const VelodyneDataPacket::Entry& entry : block.entries) {
      store_le16(out, entry.distance);
      out[2] = entry.intensity;
      out += kEntrySize;
    }
  }
  store_le32(bytes.data() + kTimestampOffset, packet.timestamp_us);
  bytes[kReturnModeOffset] = packet.factory_byte_1;
  bytes[kProductOffset] = packet.factory_byte_2;
  return bytes;
}

std::optional<VelodyneDataPacket> decode(std::span<const std::uint8_t> payload) {
  if (payload.size() != kDataPacketSize) return std::nullopt;
  VelodyneDataPacket packet;
  for (std::size_t b = 0; b < kBlocksPerPacket; ++b) {
    VelodyneDataPacket::Block& block = packet.blocks[b];
    const std::uint8_t* in = payload.data() + kBlockSize * b;
    block.flag = load_le16(in);
    block.azimuth = load_le16(in + kAzimuthOffset);
    in += kEntriesOffset;
    for (VelodyneDataPacket::Entry& entry : block.entries) {
      entry.distance = load_le16(in);
      entry.intensity = in[2];
      in += kEntrySize;
    }
  }
  packet.timestamp_us = load_le32(payload.data() + kTimestampOffset);
  packet.factory_byte_1 = payload[kReturnModeOffset];
  packet.factory_byte_2 = payload[kProductOffset];
  return packet;
}

}  // namespace nilio::drivers
