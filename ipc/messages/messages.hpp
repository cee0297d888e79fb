#pragma once

#include "nilio/core/time.hpp"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace nilio::dds {

/// nav_msgs/Odometry. Covariances are row-major 6x6 over (x, y, z, rotation about x, y, z).
struct Odometry {
  core::Time stamp;
  std::string frame_id;        ///< frame of the pose
  std::string child_frame_id;  ///< frame of the twist
  std::array<double, 3> position{};
  std::array<double, 4> orientation_xyzw{0.0, 0.0, 0.0, 1.0};
  std::array<double, 36> pose_covariance{};
  std::array<double, 3> linear_velocity{};
  std::array<double, 3> angular_velocity{};
  std::array<double, 36> twist_covariance{};

  friend bool operator==(const Odometry&, const Odometry&) = default;
};

/// geometry_msgs/TransformStamped: T_frame_child.
struct TransformStamped {
  core::Time stamp;
  std::string frame_id;
  std::string child_frame_id;
  std::array<double, 3> translation{};
  std::array<double, 4> rotation_xyzw{0.0, 0.0, 0.0, 1.0};

  friend bool operator==(const TransformStamped&, const TransformStamped&) = default;
};

/// tf2_msgs/TFMessage.
struct TransformMessage {
  std::vector<TransformStamped> transforms;

  friend bool operator==(const TransformMessage&, const TransformMessage&) = default;
};

/// Bucket of values from `from_us` (inclusive) to `to_us` (exclusive).
struct LatencyBucket {
  double from_us = 0.0;
  double to_us = 0.0;
  std::uint64_t count = 0;

  friend bool operator==(const LatencyBucket&, const LatencyBucket&) = default;
};

/// Duration of one stage in microseconds since the publisher process started.
struct StageLatency {
  std::string name;
  std::uint64_t count = 0;
  double p50_us = 0.0;
  double p90_us = 0.0;
  double p99_us = 0.0;
  double p99_9_us = 0.0;
  double max_us = 0.0;
  std::vector<LatencyBucket> buckets;  ///< non-empty ones, in order

  friend bool operator==(const StageLatency&, const StageLatency&) = default;
};

/// nilio/LatencyReport.
struct LatencyReport {
  core::Time stamp;
  std::vector<StageLatency> stages;
  std::uint64_t poses_published = 0;
  std::uint64_t failed_writes = 0;
  std::uint64_t ring_dropped = 0;
  std::uint64_t ring_high_water = 0;
  std::uint64_t imu_poses_published = 0;
  std::uint64_t imu_ring_dropped = 0;
  std::uint64_t imu_ring_high_water = 0;

  friend bool operator==(const LatencyReport&, const LatencyReport&) = default;
};

/// Time of one stage of a scan, CLOCK_MONOTONIC of the machine with ScanReport::host_id; 0 = unknown.
struct StageStamp {
  std::string name;
  std::int64_t monotonic_ns = 0;

  friend bool operator==(const StageStamp&, const StageStamp&) = default;
};

/// nilio/ScanReport: result and stage times of one scan.
struct ScanReport {
  core::Time stamp;       ///< last firing; stamp of the odometry message
  core::Time scan_start;  ///< first firing
  std::uint64_t sequence = 0;
  std::string state;
  std::string stop_reason;
  core::Time delivered;  ///< CLOCK_REALTIME of the "delivered" stage, to relate the clocks
  std::string host_id;   ///< the kernel's boot id
  std::vector<StageStamp> stages;
  bool imu_used = false;
  bool predicted = false;
  std::uint8_t degenerate_axes = 0;
  float coverage_deg = 0.0F;
  std::uint32_t points = 0;
  std::uint32_t points_used = 0;
  std::uint32_t correspondences = 0;
  std::uint32_t coarse_iterations = 0;
  std::uint32_t fine_iterations = 0;
  std::uint32_t map_voxels = 0;
  std::uint32_t lost_packets = 0;
  std::uint32_t missing_firings = 0;
  std::uint64_t superseded = 0;
  std::string
      degradation_level;  ///< reduction of the registration for the deadline: "full", "fewer_points", ...
  bool guarded = false;   ///< registration was late and the prediction was published
  std::int64_t overshoot_ns = 0;  ///< time past the deadline, negative = early; 0 without a deadline
  std::array<double, 36>
      drift_covariance{};  ///< of the pose since the start, as that of the odometry message

  friend bool operator==(const ScanReport&, const ScanReport&) = default;
};

/// nilio/ImuPoseStatus: correction of the IMU-rate poses by a new scan pose.
struct ImuPoseStatus {
  core::Time stamp;       ///< later poses are propagated from this scan
  core::Time scan_stamp;  ///< stamp of its odometry message
  std::uint64_t scan_sequence = 0;
  double correction_m = 0.0;    ///< distance between the published and the new pose
  double correction_rad = 0.0;  ///< angle between the published and the new pose
  bool jumped = false;          ///< the correction is applied at once instead of gradually
  bool follows_gyro = false;
  std::uint64_t jumps = 0;      ///< this and the following: since the start of the publisher process
  std::uint64_t published = 0;  ///< poses
  std::uint64_t thinned = 0;    ///< samples skipped because of the rate limit
  std::uint64_t withheld = 0;   ///< samples without a pose to propagate from

  friend bool operator==(const ImuPoseStatus&, const ImuPoseStatus&) = default;
};

/// diagnostic_msgs/KeyValue.
struct KeyValue {
  std::string key;
  std::string value;

  friend bool operator==(const KeyValue&, const KeyValue&) = default;
};

/// diagnostic_msgs/DiagnosticStatus.
struct DiagnosticStatus {
  enum class Level : std::uint8_t { kOk = 0, kWarn = 1, kError = 2, kStale = 3 };

  /// A received message may contain any number.
  Level level = Level::kOk;
  std::string name;
  std::string message;
  std::string hardware_id;
  std::vector<KeyValue> values;

  friend bool operator==(const DiagnosticStatus&, const DiagnosticStatus&) = default;
};

/// diagnostic_msgs/DiagnosticArray.
struct DiagnosticArray {
  core::Time stamp;
  std::string frame_id;
  std::vector<DiagnosticStatus> statuses;

  friend bool operator==(const DiagnosticArray&, const DiagnosticArray&) = default;
};

/// sensor_msgs/PointField.
struct PointField {
  static constexpr std::uint8_t kFloat32 = 7;

  std::string name;
  std::uint32_t offset = 0;  ///< bytes from the start of a point
  std::uint8_t datatype = kFloat32;
  std::uint32_t count = 1;

  friend bool operator==(const PointField&, const PointField&) = default;
};

/// sensor_msgs/PointCloud2.
struct PointCloud2 {
  core::Time stamp;
  std::string frame_id;
  std::uint32_t height = 1;
  std::uint32_t width = 0;
  std::vector<PointField> fields;
  bool is_bigendian = false;
  std::uint32_t point_step = 0;  ///< bytes of a point
  std::uint32_t row_step = 0;    ///< bytes of a row
  std::vector<std::uint8_t> data;
  bool is_dense = true;  ///< no point is NaN

  friend bool operator==(const PointCloud2&, const PointCloud2&) = default;
};

/// geometry_msgs/PoseStamped.
struct PoseStamped {
  core::Time stamp;
  std::string frame_id;
  std::array<double, 3> position{};
  std::array<double, 4> orientation_xyzw{0.0, 0.0, 0.0, 1.0};

  friend bool operator==(const PoseStamped&, const PoseStamped&) = default;
};

/// nav_msgs/Path.
struct Path {
  core::Time stamp;
  std::string frame_id;
  std::vector<PoseStamped> poses;

  friend bool operator==(const Path&, const Path&) = default;
};

}  // namespace nilio::dds
