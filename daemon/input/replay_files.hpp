#pragma once

#include "nilio/core/result.hpp"

#include <string>
#include <vector>

namespace nilio::daemon {

/// Input files of a replay, sorted by kind.
struct ReplayFiles {
  std::vector<std::string> captures;    ///< pcap or pcapng, in order; several are parts of one recording
  std::vector<std::string> can_logs;    ///< candump, in order
  std::vector<std::string> bags;        ///< ROS bags: the parts of one recording
  std::string configuration;            ///< nilio.yaml of the recording
  std::string kitti_sequence;           ///< folder of a KITTI sequence
  std::vector<std::string> unreadable;  ///< unfinished (drivers::kPartialSuffix) or compressed files
};

/// Sorts folders and files by kind, recognised by their content (drivers::file_kind()). Numbered files of
/// `nilio record` (lidar_0001.pcap, can_0001.log) are parts of one recording, in numerical order. Otherwise
/// more than one file of a kind is an error that names them, unless they are parts of one ROS bag: named one
/// by one, by their metadata.yaml, or by a number at the end of their names (name_0.bag, name_1.bag).
core::Result<ReplayFiles> sort_replay_files(const std::vector<std::string>& paths);
/// As sort_replay_files(); also fails without a capture, a ROS bag or a KITTI sequence.
core::Result<ReplayFiles> find_replay_files(const std::vector<std::string>& paths);

/// Adds a warning for each gap in the numbers of the parts. Rotation (--keep) removes only the oldest parts
/// and leaves no gap.
void warn_of_missing_parts(const std::vector<std::string>& parts, std::vector<std::string>& warnings);

}  // namespace nilio::daemon
