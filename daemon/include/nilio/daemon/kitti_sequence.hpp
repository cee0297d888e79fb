#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/daemon/scan_feed.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

/// A folder of the KITTI odometry benchmark: velodyne/NNNNNN.bin, times.txt, calib.txt.
struct KittiSequence {
  std::unique_ptr<ScanFeed> feed;
  std::size_t scans = 0;
  /// "Tr" of calib.txt: LiDAR to left rectified camera, in which the benchmark states its poses.
  core::SE3 T_camera_lidar;
  /// One line for each damaged scan, which gets the predicted pose.
  std::vector<std::string> warnings;
};

bool is_kitti_sequence(const std::string& folder);

/// Fails naming the file and line. The scans are motion-compensated by the data set: they come at one
/// instant, the stamp of times.txt, and are not deskewed again.
core::Result<KittiSequence> open_kitti_sequence(const std::string& folder);

}  // namespace nilio::daemon
