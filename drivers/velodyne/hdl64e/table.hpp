#pragma once

#include "nilio/drivers/velodyne/hdl64e/status.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

/// The 1820 bytes of the status stream, and the positions of its types.
namespace nilio::drivers {

inline constexpr std::string_view kHdl64eClockTypes = "HMSDNYGTV";
inline constexpr std::size_t kHdl64eClockBytes = kHdl64eClockTypes.size();
inline constexpr std::size_t kHdl64eCycleBytes = 7;
inline constexpr std::string_view kHdl64eMarker = "UNIT#";
inline constexpr std::uint16_t kHdl64eNoCrc = kHdl64eTableSize;

using Hdl64eTable = std::span<const std::uint8_t, kHdl64eTableSize>;

/// Type of byte `place` (0 to 6) of a cycle (0 to 259), by the manual.
std::uint8_t hdl64e_type(std::size_t cycle, std::size_t place);

/// First cycle of a laser's 21 bytes; its first byte is the laser's id.
inline constexpr std::size_t hdl64e_laser_cycle(std::size_t laser) { return 1 + 4 * laser; }
/// Laser whose bytes begin in this cycle.
std::optional<std::size_t> hdl64e_laser_of_cycle(std::size_t cycle);
/// True if the first byte of the cycle holds the warnings.
bool hdl64e_is_warning_cycle(std::size_t cycle);

/// Time from six bytes: year since 2000, month, day, hour, minute, second.
std::optional<core::Time> hdl64e_time(std::span<const std::uint8_t, 6> bytes);
/// The inverse; 2000-01-01 for times outside 2000 to 2255.
std::array<std::uint8_t, 6> hdl64e_time_bytes(std::optional<core::Time> time);

/// Lasers of the table; nothing for an implausible geometry. Implausible focus and intensity limits are left
/// unknown, because points do not need them.
std::optional<std::array<LaserCalibration, kHdl64eLasers>> hdl64e_lasers(Hdl64eTable table);
Hdl64eUnit hdl64e_unit(Hdl64eTable table);
std::uint16_t hdl64e_sent_crc(Hdl64eTable table);
/// Byte order of the CRC over the lasers' bytes: high bytes first as in the manual's example, or as sent.
enum class Hdl64eCrcOrder : std::uint8_t { kManual, kStream };
std::uint16_t hdl64e_computed_crc(Hdl64eTable table, Hdl64eCrcOrder order);

/// Makes a table with the CRC of the manual; the error names a laser whose values do not fit.
core::Result<std::array<std::uint8_t, kHdl64eTableSize>> hdl64e_make_table(
    std::span<const LaserCalibration, kHdl64eLasers> lasers, const Hdl64eUnit& unit, Hdl64eChecksum checksum);

}  // namespace nilio::drivers
