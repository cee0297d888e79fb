#pragma once

#include "nilio/core/result.hpp"

#include "tools/inspect/recording.hpp"

#include <string>

namespace nilio::tools::inspect {

/// What a configuration is made from.
struct ConfigSubject {
  const CaptureFindings* capture = nullptr;
  const SensorFindings* sensor = nullptr;
  /// Null when there is none.
  const CanFindings* can = nullptr;
};

/// The one capture with the sensor to use, and the CAN log. `sensor_name` is "ADDRESS" or "ADDRESS:PORT";
/// empty: the one with most packets. Fails, naming the choices, when there is none, or more than one capture
/// or CAN log, of which niliod replays one.
core::Result<ConfigSubject> choose_config_subject(const RecordingFindings& findings,
                                                  const std::string& sensor_name);

/// nilio.yaml for the recording: the keys that differ from the defaults, each with a comment on what it
/// rests. `calibration_path` is that of a file written for the sensor, or empty. With a drive (may be null)
/// also what was configured for it, and what was found to be wrong with its IMU put right.
std::string make_recording_config(const ConfigSubject& subject, const std::string& calibration_path,
                                  const DriveFindings* drive = nullptr);

}  // namespace nilio::tools::inspect
