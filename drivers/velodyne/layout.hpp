#pragma once

#include <cstddef>
#include <cstdint>

/// Offsets in a Velodyne data packet (any Velodyne manual, "data packet structure").
namespace nilio::drivers {

inline constexpr std::size_t kBlockSize = 100;
inline constexpr std::size_t kAzimuthOffset = 2;
inline constexpr std::size_t kEntriesOffset = 4;
inline constexpr std::size_t kEntrySize = 3;
inline constexpr std::size_t kTimestampOffset = 1200;
inline constexpr std::size_t kReturnModeOffset = 1204;
inline constexpr std::size_t kProductOffset = 1205;

}  // namespace nilio::drivers
