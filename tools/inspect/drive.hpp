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

/// Result of the IMU check over a recording with LiDAR.
struct DriveFindings {
  /// Configuration of the run, and its file; empty = the defaults and the contents of the CAN log.
  daemon::Config config;
  std::string config_path;
  std::uint64_t poses = 0;
  /// Poses that are predictions without registration.
  std::uint64_t predicted = 0;
  /// Poses for which the gyroscope was used.
  std::uint64_t with_gyro = 0;
  std::uint64_t imu_samples = 0;
  double seconds = 0.0;
  /// It ended before the end of the recording.
  bool cut_short = false;
  core::ImuHealth health;
  ImuCalibration calibration;
  /// Poses for which the gyroscope was used with the correction; unset without a correction.
  std::optional<std::uint64_t> with_gyro_corrected;
};

struct DriveOptions {
  /// Maximum length of the run, from the start of the recording.
  double seconds = 0.0;
  /// Called with the processed seconds; may be empty.
  std::function<void(double)> progress;
};

/// Runs niliod's odometry over the recording and compares the IMU with the registered motion; if there is a
/// correction, a second run with it refines the result. Checks are those of the first run. Fails when the
/// recording cannot be replayed with this configuration, or has no sample of the configured IMU.
core::Result<DriveFindings> inspect_drive(const daemon::ReplayFiles& files, const daemon::Config& config,
                                          const DriveOptions& options);

}  // namespace nilio::tools::inspect
