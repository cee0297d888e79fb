#pragma once

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/imu_health.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/core/tracking.hpp"

#include <array>
#include <cstdint>
#include <type_traits>

namespace nilio::ipc {

/// Stages of a scan in the process, in order.
enum class Stage : std::uint8_t {
  kReceived,   ///< last packet of the scan received
  kPopped,     ///< last packet taken off the ring
  kCompleted,  ///< scan cut
  kStarted,    ///< odometry began
  kFiltered,   ///< range gate, voxel filter and first deskewing done
  kCoarse,     ///< NDT done (equal to kFiltered when skipped)
  kFine,       ///< ICP done
  kDelivered,  ///< pose written into the publisher's ring
  kMapped,     ///< map updated; unknown to the publisher
  kCount
};
inline constexpr std::size_t kStageCount = static_cast<std::size_t>(Stage::kCount);

using core::StopReason;
using core::TrackingState;

/// Pose of one scan with its state and counters; passed between threads and processes by value. Frames: odom
/// -> base_link. Covariances are row-major 6x6 over (x, y, z, rotation about x, y, z), in the order of ROS:
/// those of the pose in odom, that of the twist in base_link.
struct PoseRecord {
  std::uint64_t sequence = 0;
  std::int64_t stamp_ns = 0;       ///< end of scan; time of the pose
  std::int64_t scan_start_ns = 0;  ///< first firing
  std::array<double, 3> position{};
  std::array<double, 4> orientation_xyzw{0.0, 0.0, 0.0, 1.0};
  /// Pose half-way between scan_start_ns and stamp_ns.
  std::array<double, 3> middle_position{};
  std::array<double, 4> middle_orientation_xyzw{0.0, 0.0, 0.0, 1.0};
  std::array<double, 36> pose_covariance{};   ///< against the map
  std::array<double, 36> drift_covariance{};  ///< since the start, with the drift of the map
  std::array<double, 3> linear_velocity{};    ///< m/s in base_link
  std::array<double, 3> angular_velocity{};   ///< rad/s in base_link
  std::array<double, 36> twist_covariance{};
  /// Mean angular rate used for the first deskewing, rad/s in base_link; 0 without deskewing.
  std::array<double, 3> deskew_rate{};
  TrackingState state = TrackingState::kInitialising;
  StopReason stop_reason = StopReason::kConverged;
  /// Gyro bias, rad/s in base_link, and time shift; both are subtracted from the IMU's samples.
  std::array<double, 3> gyro_bias{};
  std::int64_t imu_time_shift_ns = 0;
  /// Accelerometer bias, m/s^2 in base_link, and gravity in odom.
  std::array<double, 3> accelerometer_bias{};
  std::array<double, 3> gravity{};
  bool imu_used = false;
  bool accelerometer_used = false;
  core::ClockSource clock_source = core::ClockSource::kHost;
  bool after_time_jump = false;
  bool predicted = false;            ///< no registration; the pose is the prediction
  std::uint8_t degenerate_axes = 0;  ///< bit i: axis i (x y z rx ry rz of base_link) follows the prediction
  core::DegradationLevel degradation_level = core::DegradationLevel::kFull;
  /// The scan had the larger budget of a recovery.
  bool recovery_budget = false;
  bool guarded = false;  ///< registration was late: the deadline guard published the prediction
  /// Delivery time minus deadline in ns (negative = early; valid if has_deadline), and estimated duration of
  /// one ICP iteration in ns.
  bool has_deadline = false;
  std::int64_t overshoot_ns = 0;
  std::int64_t iteration_ns = 0;
  std::uint16_t coarse_iterations = 0;
  std::uint16_t fine_iterations = 0;
  std::uint32_t points = 0;       ///< points of the scan
  std::uint32_t points_used = 0;  ///< points of the registration
  std::uint32_t correspondences = 0;
  std::uint32_t map_voxels = 0;
  std::uint32_t lost_packets = 0;
  std::uint32_t missing_firings = 0;
  float coverage_deg = 0.0F;
  std::uint64_t superseded = 0;  ///< scans skipped for newer ones since the start
  /// CLOCK_MONOTONIC, ns; 0 = unknown.
  std::array<std::int64_t, kStageCount> stage_ns{};
  /// CLOCK_REALTIME at delivery, ns.
  std::int64_t delivered_realtime_ns = 0;
  /// State of the IMU; valid if has_imu.
  bool has_imu = false;
  core::ImuHealth imu_health{};

  /// Time at which the stage ended; 0 = unknown.
  [[nodiscard]] std::int64_t stage_time_ns(Stage stage) const {
    return stage_ns[static_cast<std::size_t>(stage)];
  }
};

/// IMU sample for the publisher process; passed by value.
struct ImuRecord {
  core::ImuSample sample;
  std::int64_t received_ns = 0;  ///< receive time of its last CAN frame, CLOCK_MONOTONIC
};

static_assert(std::is_trivially_copyable_v<PoseRecord> && std::is_trivially_copyable_v<ImuRecord>);

}  // namespace nilio::ipc
