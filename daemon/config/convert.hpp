#pragma once

#include "nilio/core/odometry.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"

#include "daemon/config/config.hpp"
#include "ipc/imu_pose_stream.hpp"

namespace nilio::daemon {

/// Conversions of configuration values into the types of core, drivers and ipc.
core::SE3 to_transform(const ExtrinsicConfig& extrinsic);
float elevation_correction_rad(const LidarConfig& lidar);
core::OdometryConfig odometry_config(const Config& config);
ipc::ImuPoseConfig imu_pose_config(const Config& config);
/// `live`: live rules apply.
core::BudgetConfig budget_config(const OdometrySection& odometry, bool live);
drivers::ScanAssemblerConfig assembler_config(const LidarConfig& lidar);

}  // namespace nilio::daemon
