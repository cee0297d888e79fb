#pragma once

#include "nilio/core/result.hpp"

#include "tools/mangle/faults.hpp"
#include "tools/mangle/packet_faults.hpp"
#include "tools/mangle/return_faults.hpp"

#include <cstdint>
#include <filesystem>
#include <string>

namespace nilio::tools::mangle {

/// Options of "nilio mangle".
struct Options {
  std::string input;   ///< folder of a recording or of a KITTI odometry sequence, or a capture
  std::string output;  ///< new folder
  Faults faults;
};

/// Counts of a copy.
struct Summary {
  PacketCounts packets;  ///< zero for a KITTI sequence
  ReturnCounts returns;  ///< zero where the returns were not changed
  std::uint64_t scans = 0;
  std::uint64_t scans_dropped = 0;
};

/// Text for people, one line a fault.
std::string to_text(const Summary& summary);

/// Writes a copy of a recording with faults: lidar.pcap and the CAN logs, or the scans, times and poses of a
/// KITTI sequence; beside it truth, configuration and calibration, so that it replays and evaluates as the
/// original, and mangle.json with the options and counts. The same options give the same bytes. Fails for
/// faults that the recording cannot have, for gaps that hold no packet or scan, and for an output folder that
/// is not empty.
core::Result<Summary> mangle(const Options& options);

// Of mangle(), by kind of recording.

/// A capture, or a folder with captures.
core::Result<Summary> mangle_packets(const Options& options);
core::Result<Summary> mangle_kitti(const std::filesystem::path& sequence, const Options& options);

}  // namespace nilio::tools::mangle
