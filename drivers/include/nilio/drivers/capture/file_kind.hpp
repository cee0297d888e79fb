#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace nilio::drivers {

enum class FileKind : std::uint8_t { kCapture, kCanLog, kBag, kCompressed, kOther };

/// Kind of a recorded file by its first 4 KiB, whatever its name: a capture by its magic number, a CAN log by
/// a line of 'candump -L' or '-l', a ROS bag (rosbag1, SQLite, MCAP) by its magic number. Names (.pcap,
/// .pcapng, .cap, .candump) count only for unrecognised content, so that damaged files get the reader's
/// message. Compressed: a recording by its name that is packed by gzip, xz, zstd or bzip2 and cannot be read
/// so. A file with kPartialSuffix is of no kind.
FileKind file_kind(const std::string& path);

/// Contents and remedy of a file that cannot be read: "is compressed (gzip); unpack it with 'gunzip PATH'".
std::string why_no_recording(const std::string& path);

/// Suffix of a file that is still being written, or whose writer was interrupted.
inline constexpr std::string_view kPartialSuffix = ".partial";

}  // namespace nilio::drivers
