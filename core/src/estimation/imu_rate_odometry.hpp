#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "core/src/estimation/accelerometer_judge.hpp"
#include "core/src/estimation/imu_buffer.hpp"

#include <cstddef>
#include <optional>

namespace nilio::core {

/// What the odometry says at the end of a scan, as far as later poses follow from it.
struct ScanPose {
  Time stamp;  ///< end of the scan, LiDAR time
  SE3 T_odom_base;
  Vector3 linear_velocity = Vector3::Zero();   ///< of base_link in its own axes, m/s
  Vector3 angular_velocity = Vector3::Zero();  ///< of base_link in its own axes, rad/s
  Vector3 gyro_bias = Vector3::Zero();         ///< in base_link, rad/s
  Duration imu_time_shift;                     ///< subtracted from IMU stamps gives LiDAR time
  bool imu_trusted = false;                    ///< the odometry follows the gyro
  bool predicted = false;                      ///< no registration: the velocity is no measurement
};

/// Pose of base_link at the time of an IMU sample.
struct PropagatedPose {
  Time stamp;  ///< LiDAR time
  SE3 T_odom_base;
  Vector3 linear_velocity = Vector3::Zero();   ///< of base_link in its own axes, m/s
  Vector3 angular_velocity = Vector3::Zero();  ///< of base_link in its own axes, rad/s
  Duration age;                                ///< since the scan pose
  bool follows_gyro = false;                   ///< all the way from the scan pose
};

struct ImuPropagatorConfig {
  SE3 T_base_imu;
  /// A longer gap between samples is bridged at the scan's constant twist.
  Duration max_gap = Duration::from_milliseconds(150.0);
  /// No pose is given so long after the scan: a constant velocity says nothing any more.
  Duration max_age = Duration::from_seconds(5.0);
  /// Samples that can be replayed: 10 s at 400 Hz.
  std::size_t capacity = 4096;
};

/// Carries the last scan pose on with every IMU sample: rotation from the gyro less its bias, velocity from
/// the accelerometer where that has predicted the scans' velocities better than holding them
/// (AccelerometerJudge), else held in the axes of the vehicle. Without a trusted IMU the scan's twist is
/// held. Allocates only when made. Not thread-safe.
class ImuPropagator {
 public:
  explicit ImuPropagator(const ImuPropagatorConfig& config);

  /// A newer scan pose: samples after it that have come already are applied to it again.
  void set_scan_pose(const ScanPose& pose);
  /// The pose at the sample's time. Empty without a scan pose, for samples from before it or `max_age` after
  /// it, and for samples that are refused (time goes back, not finite).
  std::optional<PropagatedPose> add(const ImuSample& sample);

  /// Whether there is a scan pose.
  [[nodiscard]] bool has_pose() const { return has_pose_; }
  /// LiDAR time of the last sample or scan pose, whichever is later.
  [[nodiscard]] Time latest() const { return imu_time_ - scan_.imu_time_shift; }
  /// The pose at a time near latest(), at the twist of then.
  [[nodiscard]] SE3 pose_near(Time time) const;
  /// Whether the accelerometer is followed.
  [[nodiscard]] bool follows_accelerometer() const { return accelerometer_.helps(); }

 private:
  void learn_from(const ScanPose& next);
  void step_to(std::size_t sample);
  void follow_gyro(Time to);
  [[nodiscard]] Vector3 rate_at(Time imu_time) const;
  /// Velocity that the IMU has from turning with the vehicle, in base_link.
  [[nodiscard]] Vector3 lever(const Vector3& rate) const;

  ImuPropagatorConfig config_;
  ImuBuffer imu_;  ///< stamps as the IMU gave them
  bool has_pose_ = false;
  ScanPose scan_;
  Time imu_time_;  ///< of the state, in the IMU's time
  SE3 T_odom_base_;
  Vector3 velocity_ = Vector3::Zero();  ///< in base_link
  Vector3 angular_velocity_ = Vector3::Zero();
  bool follows_gyro_ = false;
  AccelerometerJudge accelerometer_;
};

/// Covariance of a pose (position then rotation, odom axes) `age` after the scan that `pose` and `twist`
/// (base_link axes) are of, when the twist was held since.
Matrix6 propagated_covariance(const Matrix6& pose, const Matrix6& twist,
                              const Eigen::Quaterniond& R_odom_base, Duration age);

}  // namespace nilio::core
