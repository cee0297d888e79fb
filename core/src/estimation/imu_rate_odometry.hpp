#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "core/src/estimation/imu_buffer.hpp"
#include "core/src/estimation/motion_filter.hpp"

#include <cstddef>
#include <optional>

namespace nilio::core {

/// State of the odometry at the end of a scan, from which later poses are propagated.
struct ScanPose {
  MotionState state;                ///< in odom, at the end of the scan in LiDAR time
  Duration imu_time_shift;          ///< subtracted from IMU stamps gives LiDAR time
  bool gyro_used = false;           ///< by the odometry
  bool accelerometer_used = false;  ///< by the odometry
};

/// Pose of base_link at the time of an IMU sample.
struct PropagatedPose {
  Time stamp;  ///< LiDAR time
  SE3 T_odom_base;
  Vector3 linear_velocity = Vector3::Zero();   ///< of base_link in its own axes, m/s
  Vector3 angular_velocity = Vector3::Zero();  ///< of base_link in its own axes, rad/s
  Duration age;                                ///< since the scan pose
  bool follows_gyro = false;                   ///< over the whole span since the scan pose
};

struct ImuRateOdometryConfig {
  SE3 T_base_imu;
  /// A longer gap between samples is bridged at the scan's constant twist.
  Duration max_gap = Duration::from_milliseconds(60.0);
  /// Maximum age of the scan pose; later, a propagated pose would be meaningless.
  Duration max_age = Duration::from_seconds(5.0);
  /// Samples kept for repropagation: 10 s at 400 Hz.
  std::size_t capacity = 4096;
};

/// Propagates the state that the motion filter had after the last scan with every IMU sample, by the same
/// equations and with the sensors that the odometry uses: without an accelerometer the velocity is constant
/// in the vehicle's axes, without a gyro the scan's rates go on. Allocates only at construction. Not
/// thread-safe.
class ImuRateOdometry {
 public:
  explicit ImuRateOdometry(const ImuRateOdometryConfig& config);

  /// Sets a newer scan pose and repropagates the samples after it.
  void set_scan_pose(const ScanPose& pose);
  /// Returns the pose at the sample's time. Empty without a scan pose, for samples before it or `max_age`
  /// after it, and for refused samples (stamp goes back, not finite).
  std::optional<PropagatedPose> add(const ImuSample& sample);

  /// Whether there is a scan pose.
  [[nodiscard]] bool has_pose() const { return has_pose_; }
  /// LiDAR time of the last sample or scan pose, whichever is later.
  [[nodiscard]] Time latest() const { return state_.time - scan_.imu_time_shift; }
  /// The pose at a time near latest(), extrapolated with the current twist.
  [[nodiscard]] SE3 pose_near(Time time) const;

 private:
  void step_to(std::size_t sample);

  ImuRateOdometryConfig config_;
  ImuBuffer imu_;  ///< stamps as the IMU gave them
  bool has_pose_ = false;
  ScanPose scan_;
  MotionState state_;  ///< in odom, at a time of the IMU
  bool follows_gyro_ = false;
};

/// Covariance (position then rotation, odom axes) `age` after a scan with covariances `pose` and `twist`
/// (base_link axes), for a constant twist since.
Matrix6 propagated_covariance(const Matrix6& pose, const Matrix6& twist,
                              const Eigen::Quaterniond& R_odom_base, Duration age);

}  // namespace nilio::core
