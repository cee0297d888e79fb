#pragma once

#include "daemon/config/config.hpp"
#include "daemon/input/replay_files.hpp"
#include "tools/inspect/recording.hpp"

#include <string>
#include <vector>

namespace nilio::tools::inspect {

/// Options of "nilio inspect".
struct Options {
  /// Captures, CAN logs, and folders of them.
  std::vector<std::string> paths;
  /// File for the findings as JSON; "-" = only JSON, to standard output; empty = none.
  std::string json_path;
  /// File for a configuration of the recording; empty = none.
  std::string config_path;
  /// File for the calibration that an HDL-64E sends; empty = none.
  std::string calibration_path;
  /// "ADDRESS" or "ADDRESS:PORT" of the sensor to write for; empty = the one with most packets.
  std::string sensor;
  /// Configuration to check the IMU with; empty = the recording's own, or the defaults.
  std::string drive_config_path;
  /// DBC file to name the messages of CAN logs with; empty = none.
  std::string dbc_path;
  /// Longest part of the recording that the IMU is checked over, s; 0 = no check.
  double imu_seconds = 300.0;
};

/// Reports what the recording contains and writes the requested files. Returns the exit status: 1 when no
/// file is usable or a file could not be written, with messages on standard error.
int run(const Options& options);

/// Without a configuration the IMU is the one found in the log.
void take_imu_from_log(const RecordingFindings& findings, daemon::Config& config);

/// Runs the IMU check over the first `seconds` and adds its result to the findings.
void check_imu(const daemon::ReplayFiles& files, const daemon::Config& config, double seconds,
               RecordingFindings& findings);

}  // namespace nilio::tools::inspect
