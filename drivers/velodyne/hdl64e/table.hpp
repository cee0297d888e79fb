#pragma once

#include "nilio/drivers/velodyne/hdl64e/status.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

/// The 1820 bytes that the stream spells, and where its types are.
namespace nilio::drivers {

inline constexpr std::string_view kHdl64eClockTypes = "HMSDNYGTV";
inline constexpr std::size_t kHdl64eClockBytes = kHdl64eClockTypes.size();
inline constexpr std::size_t kHdl64eCycleBytes = 7;
inline constexpr std::string_view kHdl64eMarker = "UNIT#";
inline constexpr std::uint16_t kHdl64eNoCrc = kHdl64eTableSize;

using Hdl64eTable = std::span<const std::uint8_t, kHdl64eTableSize>;

/// Type that the manual gives to byte `place` (0 to 6) of a cycle (0 to 259).
std::uint8_t hdl64e_type(std::size_t cycle, std::size_t place);

/// Cycle that begins a laser's 21 bytes; its first byte is the laser's id.
inline constexpr std::size_t hdl64e_laser_cycle(std::size_t laser) { return 1 + 4 * laser; }
/// The laser whose bytes begin in this cycle.
std::optional<std::size_t> hdl64e_laser_of_cycle(std::size_t cycle);
/// The first byte is the warnings.
bool hdl64e_is_warning_cycle(std::size_t cycle);

/// Six bytes: year since 2000, month, day, hour, minute, second.
std::optional<core::Time> hdl64e_time(std::span<const std::uint8_t, 6> bytes);
/// 2000-01-01 for times that do not fit.
std::array<std::uint8_t, 6> hdl64e_time_bytes(std::optional<core::Time> time);

/// Nothing where the geometry of a laser cannot be meant. Focus and intensity limits that cannot be are left
/// unknown, since points do not need them.
std::optional<std::array<LaserCalibration, kHdl64eLasers>> hdl64e_lasers(Hdl64eTable table);
Hdl64eUnit hdl64e_unit(Hdl64eTable table);
std::uint16_t hdl64e_sent_crc(Hdl64eTable table);
/// Of the lasers' bytes: with high bytes first as in the manual's example, or as they are sent.
enum class Hdl64eCrcOrder : std::uint8_t { kManual, kStream };
std::uint16_t hdl64e_computed_crc(Hdl64eTable table, Hdl64eCrcOrder order);

/// The inverse, with the CRC of the manual; or the laser whose values do not fit.
core::Result<std::array<std::uint8_t, kHdl64eTableSize>> hdl64e_make_table(
    std::span<const LaserCalibration, kHdl64eLasers> lasers, const Hdl64eUnit& unit, Hdl64eChecksum checksum);

}  // namespace nilio::drivers
