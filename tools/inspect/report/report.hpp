#pragma once

#include "tools/inspect/recording.hpp"

#include <string>
#include <vector>

namespace nilio::tools::inspect {

/// For people: sections for each capture, its sensors, and each CAN log.
std::string inspect_report(const RecordingFindings& findings);
/// One part of it.
std::string sensor_report(const SensorFindings& sensor);
std::string can_report(const CanFindings& can);
std::string imu_check_report(const DriveFindings& drive);

/// The same as JSON; what was not seen is null.
std::string inspect_json(const RecordingFindings& findings);

/// "PPS locked", "free-running" and the like.
const char* clock_source_name(core::ClockSource source);
/// "single (strongest)": the mode with what the mode byte adds to it.
std::string return_mode_text(const SensorFindings& sensor);

/// One configuration key to be changed.
struct CorrectedKey {
  std::string path;   ///< "imu.time_offset_ms"
  std::string value;  ///< as YAML has it
  std::string why;
};

/// What the correction means for the configuration that the drive was run with; empty = nothing.
std::vector<CorrectedKey> corrected_keys(const DriveFindings& drive);
/// That configuration with the correction.
daemon::Config corrected_config(const DriveFindings& drive);

/// Roll, pitch and yaw with their errors, or that the drive does not show them.
std::string observed_text(const ImuCalibration& calibration);

/// "[0, 90, -1.5]", rounded to what a mounting can be known to.
std::string numbers_text(const std::vector<double>& numbers);

}  // namespace nilio::tools::inspect
