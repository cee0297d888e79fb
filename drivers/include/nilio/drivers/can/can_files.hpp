#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/source.hpp"

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::drivers {

/// One frame of a text log.
struct CandumpLine {
  CanFrame frame;
  std::string interface_name;
};

/// Reads one line of a candump log: "(seconds.fraction) interface id#data", "##" for CAN FD, "#R" for remote,
/// 6 or 9 digits of fraction, an optional trailing R or T. Empty for any other line.
std::optional<CandumpLine> parse_candump_line(std::string_view line);
/// The inverse; six digits of fraction, or nine where six would lose precision.
std::string format_candump_line(const CanFrame& frame, std::string_view interface_name);

/// Reads the CAN frames of a text log: candump -L and -l, the terminal output of candump (with -ta, -td and
/// -tz; status() warns when it has no times), and Vector's ASC (channel 1 = can0; its date is taken as UTC).
/// Broken lines are counted and status() quotes the first; lines that do not look like a frame are comments.
/// Fails when the file cannot be read. `interface_name` empty = all interfaces.
core::Result<std::unique_ptr<FrameSource>> open_candump(const std::string& path,
                                                        const std::string& interface_name);

/// Reads the CAN frames of a capture: recorded on one CAN interface, on several ('dumpcap -i can0 -i eth0',
/// pcapng) or on all ('tcpdump -i any'). For a capture with LiDAR packets, too, open the file a second time
/// with open_pcap(); both sources have the time stamps of one clock.
///
/// `interface_name`: empty = all. In a pcapng, the name in the file. Captures of 'tcpdump -i any' number the
/// interfaces: give the number that 'ip link' shows; with a name, the interface of the first CAN frame is
/// used, so that buses are not mixed. A capture of one unnamed interface is read whole.
///
/// Fails for files that are missing, empty or no capture, and for link types without CAN; the error names the
/// file, the reason and the remedy. Malformed frames are counted as malformed, other traffic and interfaces
/// as other; status() names the interfaces in the file.
core::Result<std::unique_ptr<FrameSource>> open_can_capture(const std::string& path,
                                                            const std::string& interface_name);

/// True when one of the capture's first 20,000 records is a CAN frame. False for unreadable files.
bool has_can_frames(const std::string& path);

/// The files of one recording as one source; see chain_captures(). `interface_name` as in open_can_capture().
core::Result<std::unique_ptr<FrameSource>> chain_can_captures(std::vector<std::string> paths,
                                                              const std::string& interface_name);
/// The same for text logs; `interface_name` as in open_candump().
core::Result<std::unique_ptr<FrameSource>> chain_can_logs(std::vector<std::string> paths,
                                                          const std::string& interface_name);

}  // namespace nilio::drivers
