#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/source.hpp"

#include <memory>
#include <string>

namespace nilio::drivers {

/// The CAN frames of a capture: recorded on a CAN interface, on several together ('dumpcap -i can0 -i eth0',
/// pcapng) or on all ('tcpdump -i any'). A capture that has LiDAR packets, too, is opened a second time by
/// open_pcap(); both have the stamps of one clock.
///
/// `interface_name`: empty = all. In a pcapng the name that is in the file. Captures of 'tcpdump -i any'
/// number the interfaces: give the number that 'ip link' shows; with a name, the interface of the first CAN
/// frame is taken, so that buses are not mixed. A capture of one interface without a name is taken whole.
///
/// Fails with what, where and what to do for files that are missing, empty or no capture, and for link types
/// that carry no CAN. Frames that make no sense are counted as malformed, other traffic and interfaces as
/// other; status() names the interfaces seen.
core::Result<std::unique_ptr<FrameSource>> open_can_capture(const std::string& path,
                                                            const std::string& interface_name);

/// Whether one of the capture's first 20,000 records is a CAN frame. False for what cannot be read.
bool has_can_frames(const std::string& path);

}  // namespace nilio::drivers
