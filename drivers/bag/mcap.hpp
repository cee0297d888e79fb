#pragma once

#include <array>
#include <cstdint>

namespace nilio::drivers::bag::mcap {

/// First and last bytes of an MCAP file of version 0.
inline constexpr std::array<std::uint8_t, 8> kMagic{0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};
/// Opcode and u64 length before the content of a record.
inline constexpr std::size_t kRecordHead = 9;
/// Content of a footer: start of the summary, start of its offsets, checksum.
inline constexpr std::size_t kFooterContent = 8 + 8 + 4;
/// Content of a message before its data: channel, sequence, log time, publish time.
inline constexpr std::size_t kMessageHead = 2 + 4 + 8 + 8;

/// Opcodes of the records that are read or written (MCAP specification, "Records").
enum Op : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kStatistics = 0x0B,
  kSummaryOffset = 0x0E,
  kDataEnd = 0x0F,
};

}  // namespace nilio::drivers::bag::mcap
