#pragma once

#include "nilio/core/imu_health.hpp"
#include "nilio/core/result.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/replay_files.hpp"
#include "tools/inspect/imu_calibration/imu_calibration.hpp"

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace nilio::tools::inspect {

/// What the odometry says about the IMU of a recording with LiDAR.
struct DriveFindings {
  /// What the drive was run with, and where from; empty = the defaults and what was found in the CAN log.
  daemon::Config config;
  std::string config_path;
  std::uint64_t poses = 0;
  /// Poses that are a prediction: nothing could be registered.
  std::uint64_t predicted = 0;
  /// Poses for which the gyroscope was used.
  std::uint64_t with_gyro = 0;
  std::uint64_t imu_samples = 0;
  double seconds = 0.0;
  /// It ended before the recording did.
  bool cut_short = false;
  core::ImuHealth health;
  ImuCalibration calibration;
  /// Poses for which the gyroscope was used once it was corrected; nothing without a correction.
  std::optional<std::uint64_t> with_gyro_corrected;
};

struct DriveOptions {
  /// Longest part of the recording, from its start.
  double seconds = 0.0;
  /// Called with the seconds that are done; may be empty.
  std::function<void(double)> progress;
};

/// Runs niliod's odometry over the recording and compares the IMU with what it registers; where something is
/// to be corrected, once more with that, for what is left. Checks are those of the first run. Fails when the
/// recording cannot be replayed with this configuration, or has no sample of the configured IMU.
core::Result<DriveFindings> inspect_drive(const daemon::ReplayFiles& files, const daemon::Config& config,
                                          const DriveOptions& options);

}  // namespace nilio::tools::inspect
