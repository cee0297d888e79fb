#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "core/src/estimation/imu_rate_odometry.hpp"
#include "core/src/estimation/pose_slew_limiter.hpp"
#include "ipc/records.hpp"
#include "ipc/ring.hpp"

#include <array>
#include <cstdint>
#include <optional>

namespace nilio::ipc {

struct ImuPoseConfig {
  core::ImuRateOdometryConfig propagation;
  core::PoseSlewLimits slew;
  double max_rate_hz = 0.0;  ///< samples above this rate are skipped; 0: a pose for every sample
};

/// IMU-rate pose. Frames, units and covariances as in PoseRecord.
struct ImuPose {
  core::Time stamp;
  core::SE3 T_odom_base;
  core::Vector3 linear_velocity = core::Vector3::Zero();
  core::Vector3 angular_velocity = core::Vector3::Zero();
  std::array<double, 36> pose_covariance{};
  std::array<double, 36> twist_covariance{};
  std::int64_t received_ns = 0;  ///< receive time of the sample
};

/// Effect of a new scan pose on the IMU-rate poses.
struct ImuPoseUpdate {
  std::uint64_t scan_sequence = 0;
  core::Time scan_stamp;
  core::Time stamp;  ///< later poses are propagated from this scan
  core::PoseCorrection correction;
};

/// Counters; each sample is counted in exactly one of published, thinned and withheld.
struct ImuPoseCounts {
  std::uint64_t samples = 0;
  std::uint64_t published = 0;
  std::uint64_t thinned = 0;   ///< because of max_rate_hz
  std::uint64_t withheld = 0;  ///< no scan pose, an outdated one, or a time not after the last pose
  std::uint64_t scan_poses = 0;
  std::uint64_t jumps = 0;
};

/// Computes IMU-rate poses from scan poses and samples in order of arrival. The output depends on this input
/// only, not on the time of the calls. Allocates only in the constructor. Not thread-safe.
class ImuPoseStream {
 public:
  explicit ImuPoseStream(const ImuPoseConfig& config);

  ImuPoseUpdate add(const PoseRecord& record);
  /// Adds a sample. Empty if no pose is published for it; counts() states the reason.
  std::optional<ImuPose> add(const ImuRecord& record);

  /// Residual correction, m and rad.
  [[nodiscard]] const core::PoseSlewLimiter& smoother() const { return smoother_; }
  [[nodiscard]] ImuPoseCounts counts() const;

 private:
  [[nodiscard]] bool is_due(core::Time stamp);
  void fill_covariances(const core::PropagatedPose& pose, ImuPose& output) const;

  core::ImuRateOdometry propagator_;
  core::PoseSlewLimiter smoother_;
  core::Duration period_;
  std::optional<core::Time> next_due_;
  std::optional<core::Time> last_smoothed_;
  core::Matrix6 pose_covariance_ = core::Matrix6::Zero();
  core::Matrix6 twist_covariance_ = core::Matrix6::Zero();
  ImuPoseCounts counts_;
};

/// True if the pose is next in the order in which the two rings were filled: it was delivered before the
/// sample was received. Poses do not wait for samples.
[[nodiscard]] inline bool pose_comes_first(const PoseRecord& pose, const ImuRecord& sample) {
  return pose.stage_time_ns(Stage::kDelivered) <= sample.received_ns;
}

}  // namespace nilio::ipc
