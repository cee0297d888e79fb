#pragma once

#include "nilio/core/time.hpp"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace nilio::dds {

/// nav_msgs/Odometry. Covariances row-major 6x6 over (x, y, z, rotation about x, y, z).
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

/// Time spent in one stage, in microseconds, since the publisher process started.
struct StageLatency {
  std::string name;
  std::uint64_t count = 0;
  double p50_us = 0.0;
  double p99_us = 0.0;
  double max_us = 0.0;

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

  friend bool operator==(const LatencyReport&, const LatencyReport&) = default;
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

  /// From the network it may be any number.
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

}  // namespace nilio::dds
