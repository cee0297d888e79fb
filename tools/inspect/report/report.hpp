#pragma once

#include "tools/inspect/recording.hpp"

#include <string>
#include <vector>

namespace nilio::tools::inspect {

/// Report for people, with a section for each capture, its sensors, and each CAN log.
std::string inspect_report(const RecordingFindings& findings);
/// One part of it.
std::string sensor_report(const SensorFindings& sensor);
std::string can_report(const CanFindings& can);
std::string imu_report(const ImuFindings& imu);
std::string imu_check_report(const DriveFindings& drive);

/// The same as JSON; missing values are null.
std::string inspect_json(const RecordingFindings& findings);

/// "single (strongest)": the return mode with the detail of the mode byte.
std::string return_mode_text(const SensorFindings& sensor);

/// A change of one configuration key.
struct CorrectedKey {
  std::string path;   ///< "imu.time_offset_ms"
  std::string value;  ///< in YAML syntax
  std::string why;
};

/// Changes of the drive's configuration for its calibration; empty = none.
std::vector<CorrectedKey> corrected_keys(const DriveFindings& drive);
/// The drive's configuration with these changes.
daemon::Config corrected_config(const DriveFindings& drive);

/// Standard deviations of roll, pitch and yaw, or "not observed".
std::string observed_text(const ImuCalibration& calibration);

/// "[0, 90, -1.5]".
std::string numbers_text(const std::vector<double>& numbers);

}  // namespace nilio::tools::inspect
