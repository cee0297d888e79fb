#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/source.hpp"

#include <memory>
#include <optional>
#include <string>
#include <string_view>

namespace nilio::drivers {

struct CandumpLine {
  CanFrame frame;
  std::string interface_name;
};

/// One line of a candump log: "(seconds.fraction) interface id#data", "##" for CAN FD, "#R" for remote, 6 or
/// 9 digits of fraction, an optional trailing R or T.
std::optional<CandumpLine> parse_candump_line(std::string_view line);
std::string format_candump_line(const CanFrame& frame, std::string_view interface_name);

/// Reads a CAN log as frames: what candump -L and -l write, what candump shows on a terminal (with -ta, -td
/// and -tz; without a time status() warns), and Vector's ASC (channel 1 = can0; its date is taken as UTC).
/// Broken lines are counted and the first is named in status(); what does not look like a frame is a comment.
/// Fails when the file cannot be read. `interface_name` empty = all interfaces.
core::Result<std::unique_ptr<FrameSource>> open_candump(const std::string& path,
                                                        const std::string& interface_name);

}  // namespace nilio::drivers
