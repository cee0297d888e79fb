#pragma once

#include <cstdint>
#include <span>

namespace nilio::mapping {

/// CRC-32C (Castagnoli): reflected polynomial 0x82F63B78; of "123456789" it is 0xE3069283. `before`: checksum
/// of the bytes before these, to continue it.
std::uint32_t crc32c(std::span<const std::uint8_t> bytes, std::uint32_t before = 0);

}  // namespace nilio::mapping
