#pragma once

#include "nilio/core/result.hpp"

#include "tools/inspect/lidar_mounting.hpp"
#include "tools/inspect/recording.hpp"

#include <string>

namespace nilio::tools::inspect {

/// Recording that a configuration is made for.
struct ConfigSubject {
  const CaptureFindings* capture = nullptr;
  const SensorFindings* sensor = nullptr;
  /// Null when there is none.
  const CanFindings* can = nullptr;
};

/// Selects the capture, the sensor and the CAN log. `sensor_name` is "ADDRESS" or "ADDRESS:PORT"; empty: the
/// one with most packets. Fails with the list of choices when there is none, or more than one capture or CAN
/// log, since niliod replays one.
core::Result<ConfigSubject> choose_config_subject(const RecordingFindings& findings,
                                                  const std::string& sensor_name);

/// Findings beyond those of the files.
struct ConfigParts {
  /// File written for the sensor's calibration, or empty.
  std::string calibration_path{};
  /// Adds the keys that the drive was configured with, with the corrections of its IMU; may be null.
  const DriveFindings* drive = nullptr;
  /// For a vehicle: adds the LiDAR's mounting, and the IMU's CAN interface; may be null.
  const LidarMounting* mounting = nullptr;
  /// Where the findings come from; empty = the files.
  std::string source{};
};

/// Configuration for the recording: the keys that differ from the defaults, each with its reason as comment.
std::string make_recording_config(const ConfigSubject& subject, const ConfigParts& parts);

}  // namespace nilio::tools::inspect
