#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/replay_files.hpp"

#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>

namespace nilio::tools::inspect {

/// Pose of a LiDAR in a drive and, for some scans, its deskewed points at that pose.
struct MountingScan {
  core::SE3 T_odom_lidar;
  /// No registration was accepted.
  bool predicted = false;
  /// In the LiDAR's frame, metres.
  std::vector<Eigen::Vector3f> points;
};

/// Mounting of a LiDAR on a vehicle that drove forwards on level ground. base_link: on the ground under the
/// LiDAR, z normal to the ground, x in the direction of most straight driving: the points alone do not tell
/// forwards from reverse.
struct LidarMounting {
  /// Scans whose ground was found; 0 = height, roll and pitch are not observed.
  std::uint64_t ground_scans = 0;
  double height_m = 0.0;
  /// Roll, pitch and yaw, R_base_lidar = Rz Ry Rx; yaw is 0 where it is not observed.
  core::Vector3 rotation_rpy_deg = core::Vector3::Zero();
  /// Standard deviation of single scans: of the height, and of the ground's slope.
  double height_deviation_m = 0.0;
  double slope_deviation_deg = 0.0;
  /// Distance driven straight; yaw is observed from kMinimumStraightM on, unless the direction is ambiguous.
  double straight_m = 0.0;
  /// Share of it against x.
  double reversed_m = 0.0;
  /// Standard deviation of the direction of single stretches.
  double yaw_deviation_deg = 0.0;

  [[nodiscard]] bool is_yaw_observed() const;
  /// More than a third of the straight driving went the other way.
  [[nodiscard]] bool is_direction_ambiguous() const;
};

inline constexpr double kMinimumStraightM = 10.0;
/// Length of a stretch that gives one direction.
inline constexpr double kStretchM = 5.0;

/// Estimates height, roll and pitch from the ground near the vehicle, and yaw from straight driving.
LidarMounting estimate_lidar_mounting(const std::vector<MountingScan>& scans);

/// The same for the first `seconds` of a recording, by niliod's odometry with `config`, whose lidar.extrinsic
/// is ignored. Fails when the recording cannot be replayed.
core::Result<LidarMounting> find_lidar_mounting(const daemon::ReplayFiles& files, daemon::Config config,
                                                double seconds);

}  // namespace nilio::tools::inspect
