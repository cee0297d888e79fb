#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"

#include "daemon/input/scan_feed.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Sequence of the KITTI odometry benchmark: velodyne/NNNNNN.bin, times.txt, calib.txt.
struct KittiSequence {
  std::unique_ptr<ScanFeed> feed;
  std::size_t scans = 0;
  /// "Tr" of calib.txt: LiDAR to left rectified camera, the frame of the benchmark's poses.
  core::SE3 T_camera_lidar;
  /// One line for each damaged scan, which gets the predicted pose.
  std::vector<std::string> warnings;
};

bool is_kitti_sequence(const std::string& folder);

/// Opens a sequence; the error names file and line. The data set's scans are already motion-compensated: all
/// points have the stamp of times.txt and are not deskewed again.
core::Result<KittiSequence> open_kitti_sequence(const std::string& folder);

}  // namespace nilio::daemon
