#pragma once

#include "nilio/core/odometry.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"

#include "daemon/config/config.hpp"
#include "ipc/imu_pose_stream.hpp"

namespace nilio::daemon {

/// Configuration in the core's and the drivers' own terms.
core::SE3 to_transform(const ExtrinsicConfig& extrinsic);
float elevation_correction_rad(const LidarConfig& lidar);
core::OdometryConfig odometry_config(const Config& config);
ipc::ImuPoseConfig imu_pose_config(const Config& config);
/// `live`: the rules of a live run hold.
core::BudgetConfig budget_config(const OdometrySection& odometry, bool live);
drivers::ScanAssemblerConfig assembler_config(const LidarConfig& lidar);

}  // namespace nilio::daemon
