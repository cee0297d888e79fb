#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "tools/simulate/random.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::simulate {

/// Faults of an IMU for a recording. Faults of mounting, unit and clock last the whole drive; dropouts and
/// stuck values begin half way through it.
struct ImuFaultConfig {
  /// Axis i of the recording is axis_sign[i] times the IMU's axis axis_source[i].
  std::array<std::uint8_t, 3> axis_source{0, 1, 2};
  std::array<double, 3> axis_sign{1.0, 1.0, 1.0};
  /// Rotation of the mounting relative to the configured one.
  core::Vector3 mounting_rotation_deg = core::Vector3::Zero();
  bool gyro_in_degrees = false;
  bool accel_in_g = false;
  /// Added to all stamps.
  double time_offset_ms = 0.0;
  /// Added to the x, y and z axis.
  double gyro_bias_deg_s = 0.0;
  double dropout_s = 0.0;
  /// Share of CAN frames, 0 to 1.
  double frames_lost = 0.0;
  bool stuck = false;
  /// Full scale of the gyroscope, deg/s; 0 = unlimited.
  double gyro_range_deg_s = 0.0;
};

/// Parses faults as "NAME" or "NAME=VALUE". Errors name the fault, its unit and range, or list the valid
/// names.
core::Result<ImuFaultConfig> parse_imu_faults(const std::vector<std::string>& faults);
/// One line per fault for `--help`.
std::string describe_imu_faults();

/// Applies faults to a stream of samples; one thread.
class ImuFaults {
 public:
  ImuFaults(const ImuFaultConfig& config, core::Time start, double duration_s, std::uint64_t seed);

  /// The sample as the faulty IMU would send it; unset during a dropout.
  std::optional<core::ImuSample> apply(const core::ImuSample& sample);
  /// Whether the next CAN frame is lost.
  bool loses_frame() { return config_.frames_lost > 0.0 && random_.chance(config_.frames_lost); }

 private:
  using Values = std::array<double, 3>;
  [[nodiscard]] Values as_mounted(const Values& values) const;
  [[nodiscard]] Values in_wrong_axes(const Values& values) const;

  ImuFaultConfig config_;
  core::Time onset_;
  RandomStream random_;
  std::optional<core::ImuSample> frozen_;
};

}  // namespace nilio::tools::simulate
