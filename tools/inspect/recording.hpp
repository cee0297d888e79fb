#pragma once

#include "nilio/core/result.hpp"

#include "tools/inspect/can.hpp"
#include "tools/inspect/capture.hpp"
#include "tools/inspect/drive.hpp"

#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::inspect {

/// How a CAN log lies to a capture in time.
struct TimeRelation {
  /// Both at once; 0 when they are apart.
  double overlap_s = 0.0;
  /// CAN log's start minus the capture's.
  double start_offset_s = 0.0;
  /// Between the end of one and the start of the other; 0 when they overlap.
  double apart_s = 0.0;
};

TimeRelation relate(const CanFindings& can, const CaptureFindings& capture);

/// What is in the files of a recording.
struct RecordingFindings {
  std::vector<CaptureFindings> captures;
  std::vector<CanFindings> can_logs;
  /// What driving over LiDAR and IMU says of the IMU; nothing when it was not tried or, with a reason,
  /// failed.
  std::optional<DriveFindings> drive;
  std::string drive_problem;
  /// One line for each file that is of no use, and why.
  std::vector<std::string> problems;

  [[nodiscard]] bool usable() const;
};

/// Inspects captures and CAN logs, told by their content, and those in folders (not in folders of folders).
/// Files in folders that are neither are passed over; those named by the user become problems, like what
/// cannot be read. With a DBC (may be null) the messages of CAN logs are named and decoded.
RecordingFindings inspect_recording(const std::vector<std::string>& paths,
                                    const drivers::DbcDatabase* dbc = nullptr);

}  // namespace nilio::tools::inspect
