#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"

#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <string>
#include <vector>

namespace nilio::tools::simulate {

/// T_camera_lidar of the KITTI odometry sequences 00 to 02.
core::SE3 default_kitti_calibration();

struct RecordedDriveConfig {
  std::string pose_file;
  /// Empty = default_kitti_calibration().
  std::string calibration_file;
  /// Time from one pose to the next.
  double pose_interval_s = 0.1037;
  /// Begin at the recorded speed instead of stationary.
  bool moving_start = false;
  core::SE3 T_base_lidar;
  DriveExtent extent;
};

/// Control poses (every kControlIntervalS) that follow recorded camera poses: transformed to base_link;
/// heights made consistent at revisited places; smoothed over a few tenths of a second (the jitter of
/// centimetres would be tens of metres per second squared as acceleration); unless moving_start, preceded by
/// a stationary phase and a start at no more than about 2 m/s^2. World is the first base pose.
core::Result<std::vector<core::SE3>> make_recorded_drive(const RecordedDriveConfig& config);

/// Gives a drive the same height at revisited places. Recorded heights drift by metres from one pass to the
/// next, but there is only one ground. The correction is spread over the whole drive by least squares, so
/// that slopes change by tenths of a percent; only heights change.
void close_heights(std::vector<core::SE3>& poses);

}  // namespace nilio::tools::simulate
