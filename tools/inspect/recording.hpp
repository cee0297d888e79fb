#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/bag/sources.hpp"

#include "tools/inspect/can.hpp"
#include "tools/inspect/capture.hpp"
#include "tools/inspect/drive.hpp"

#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::inspect {

/// Contents of a ROS bag.
struct BagFindings {
  std::vector<std::string> files;
  drivers::BagSurvey survey;
  /// Notes of niliod about the topics that it would use, or the reason why it cannot read the bag.
  std::vector<std::string> notes;
  std::vector<std::string> warnings;
  std::string problem;
  /// A line for each topic of a GNSS receiver.
  std::vector<std::string> gnss;

  [[nodiscard]] bool usable() const { return problem.empty(); }
};

/// Reads the whole recording for its topics, and its beginning as niliod would with the default
/// configuration.
core::Result<BagFindings> inspect_bag(const std::vector<std::string>& files);

/// Text for the user.
std::string bag_report(const BagFindings& bag);

/// Relation of a CAN log to a capture in time.
struct TimeRelation {
  /// Common time; 0 without overlap.
  double overlap_s = 0.0;
  /// Start of the CAN log minus that of the capture.
  double start_offset_s = 0.0;
  /// Time between the end of one and the start of the other; 0 when they overlap.
  double apart_s = 0.0;
};

TimeRelation relate(const CanFindings& can, const CaptureFindings& capture);

/// Contents of the files of a recording.
struct RecordingFindings {
  std::vector<CaptureFindings> captures;
  std::vector<CanFindings> can_logs;
  std::vector<BagFindings> bags;
  /// Result of the IMU check; unset if it was not run or, with a reason, failed.
  std::optional<DriveFindings> drive;
  std::string drive_problem;
  /// One line with the reason for each unusable file.
  std::vector<std::string> problems;

  [[nodiscard]] bool usable() const;
};

/// Inspects captures and CAN logs, recognised by their content, and those in folders (not recursively). Other
/// files in folders are skipped; explicitly named ones become problems, as do unreadable files. With a DBC
/// (may be null) the messages of CAN logs are named and decoded.
RecordingFindings inspect_recording(const std::vector<std::string>& paths,
                                    const drivers::DbcDatabase* dbc = nullptr);

}  // namespace nilio::tools::inspect
