#pragma once

#include "nilio/core/result.hpp"

#include <string>
#include <vector>

namespace nilio::daemon {

/// The parts of a replay found on the command line.
struct ReplayFiles {
  std::vector<std::string> captures;  ///< pcap or pcapng, in order; several are parts of one recording
  std::vector<std::string> can_logs;  ///< candump, in order
  std::string configuration;          ///< nilio.yaml that came with the recording
  std::string kitti_sequence;         ///< folder
};

/// Sorts folders and files by what they are. The numbered files that `nilio record` writes (lidar_0001.pcap,
/// can_0001.log) are parts of one recording, in the order of their numbers. Fails when more than one of a
/// kind is there otherwise, naming them.
core::Result<ReplayFiles> sort_replay_files(const std::vector<std::string>& paths);
/// As sort_replay_files(); fails also without a capture or a KITTI sequence.
core::Result<ReplayFiles> find_replay_files(const std::vector<std::string>& paths);

/// A part that is missing between others was lost, not left out on purpose: --keep takes the oldest.
void warn_of_missing_parts(const std::vector<std::string>& parts, std::vector<std::string>& warnings);

}  // namespace nilio::daemon
