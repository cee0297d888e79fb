#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/source.hpp"

#include <memory>
#include <string>
#include <vector>

namespace nilio::drivers {

/// The files of one recording as one source: the next is opened where one ends, so read() allocates at every
/// seam. A file that cannot be opened or read on is named in status(), counted as malformed and passed over.
/// Fails when there are no files or none can be opened. The counts are those of all files so far.
core::Result<std::unique_ptr<PacketSource>> chain_captures(std::vector<std::string> paths,
                                                           const PcapSourceConfig& config);
/// As chain_captures(); `interface_name` as in open_can_capture().
core::Result<std::unique_ptr<FrameSource>> chain_can_captures(std::vector<std::string> paths,
                                                              const std::string& interface_name);
/// As chain_captures(); `interface_name` as in open_candump().
core::Result<std::unique_ptr<FrameSource>> chain_can_logs(std::vector<std::string> paths,
                                                          const std::string& interface_name);

}  // namespace nilio::drivers
