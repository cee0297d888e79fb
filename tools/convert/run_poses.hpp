#pragma once

#include "nilio/core/result.hpp"

#include "tools/common/trajectory.hpp"

#include <filesystem>
#include <map>
#include <string>
#include <variant>

namespace nilio::tools::convert {

/// Poses of the topic of a bag (nav_msgs/Odometry, PoseStamped, PoseWithCovarianceStamped, TransformStamped);
/// an empty name: the only such topic. Messages whose stamp does not increase are left out. Notes about the
/// bag go to standard error.
core::Result<Trajectory> read_bag_poses(const std::string& bag, const std::string& topic);

/// Columns of scans.csv without scan number and stamp.
struct ScanColumns {
  std::string names;                        ///< "state,..."; empty without a table
  std::map<std::string, std::string> rows;  ///< by the text of the stamp
};
/// Empty for a folder without scans.csv.
ScanColumns read_scan_columns(const std::filesystem::path& folder);

/// Writes /pose, /tf and the whole path at the beginning, in frames odom and base_link.
core::Result<std::monostate> write_mcap(const Trajectory& trajectory, const std::string& path);

}  // namespace nilio::tools::convert
