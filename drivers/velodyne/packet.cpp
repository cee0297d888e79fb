#include "nilio/drivers/velodyne/packet.hpp"

#include "drivers/common/little_endian.hpp"
#include "drivers/velodyne/layout.hpp"

namespace nilio::drivers {

std::array<std::uint8_t, kDataPacketSize> encode(const VelodyneDataPacket& packet) {
  std::array<std::uint8_t, kDataPacketSize> bytes{};
  for (std::size_t b = 0; b < kBlocksPerPacket; ++b) {
    const VelodyneDataPacket::Block& block = packet.blocks[b];
    std::uint8_t* out = bytes.data() + kBlockSize * b;
    store_u16(out, block.flag);
    store_u16(out + kAzimuthOffset, block.azimuth);
    out += kEntriesOffset;
    for (const VelodyneDataPacket::Entry& entry : block.entries) {
      store_u16(out, entry.distance);
      out[2] = entry.intensity;
      out += kEntrySize;
    }
  }
  store_u32(bytes.data() + kTimestampOffset, packet.timestamp_us);
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
    block.flag = load_u16(in);
    block.azimuth = load_u16(in + kAzimuthOffset);
    in += kEntriesOffset;
    for (VelodyneDataPacket::Entry& entry : block.entries) {
      entry.distance = load_u16(in);
      entry.intensity = in[2];
      in += kEntrySize;
    }
  }
  packet.timestamp_us = load_u32(payload.data() + kTimestampOffset);
  packet.factory_byte_1 = payload[kReturnModeOffset];
  packet.factory_byte_2 = payload[kProductOffset];
  return packet;
}

}  // namespace nilio::drivers
