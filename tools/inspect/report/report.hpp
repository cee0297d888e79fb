#pragma once

#include "tools/inspect/recording.hpp"

#include <string>

namespace nilio::tools {

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

}  // namespace nilio::tools
