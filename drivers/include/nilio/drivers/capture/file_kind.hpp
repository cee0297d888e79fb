#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace nilio::drivers {

enum class FileKind : std::uint8_t { kCapture, kCanLog, kOther };

/// Kind of a recorded file by its first 4 KiB, whatever its name: a capture by its magic number, a CAN log by
/// a line of 'candump -L' or '-l'. Names (.pcap, .pcapng, .cap, .candump) count only for unrecognised
/// content, so that damaged files get the reader's message. A file with kPartialSuffix is of no kind.
FileKind file_kind(const std::string& path);

/// Contents and remedy of a file of no kind: "is compressed (gzip); unpack it with 'gunzip'".
std::string why_no_recording(const std::string& path);

/// Suffix of a file that is still being written, or whose writer was interrupted.
inline constexpr std::string_view kPartialSuffix = ".partial";

}  // namespace nilio::drivers
