#pragma once

#include "nilio/core/result.hpp"

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

/// nilio.yaml for the recording: the keys that differ from the defaults, each with its reason as comment.
/// `calibration_path` is that of a file written for the sensor, or empty. With a drive (may be null) also the
/// keys it was configured with, with the corrections of its IMU.
std::string make_recording_config(const ConfigSubject& subject, const std::string& calibration_path,
                                  const DriveFindings* drive = nullptr);

}  // namespace nilio::tools::inspect
