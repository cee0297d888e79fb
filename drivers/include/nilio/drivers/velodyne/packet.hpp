#pragma once

#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <span>

namespace nilio::drivers {

/// True for a whole datagram of the size of a data packet; its contents may still be damaged.
inline bool is_data_packet(const Packet& packet) {
  return packet.size == kDataPacketSize && !packet.truncated;
}

/// True for a whole datagram of the size of a position packet.
inline bool is_position_packet(const Packet& packet) {
  return packet.size == kPositionPacketSize && !packet.truncated;
}

/// Fields of a data packet, as defined in every Velodyne manual. encode() and decode() are exact inverses.
struct VelodyneDataPacket {
  struct Entry {
    std::uint16_t distance = 0;  ///< in units of the model's distance resolution; 0 = no return
    std::uint8_t intensity = 0;
  };
  struct Block {
    std::uint16_t flag = 0xEEFF;
    std::uint16_t azimuth = 0;  ///< 0.01 degree
    std::array<Entry, kEntriesPerBlock> entries{};
  };
  std::array<Block, kBlocksPerPacket> blocks{};
  std::uint32_t timestamp_us = 0;  ///< microseconds past the hour
  std::uint8_t factory_byte_1 = 0;
  std::uint8_t factory_byte_2 = 0;
};

std::array<std::uint8_t, kDataPacketSize> encode(const VelodyneDataPacket& packet);
/// Returns nothing unless the payload has exactly 1206 bytes.
std::optional<VelodyneDataPacket> decode(std::span<const std::uint8_t> payload);

}  // namespace nilio::drivers
