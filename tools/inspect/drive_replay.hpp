#pragma once

#include "nilio/core/result.hpp"

#include "daemon/odometry/pipeline.hpp"

#include <functional>

namespace nilio::tools::inspect {

struct DriveReplay {
  /// Maximum length of the run, from the start of the recording.
  double seconds = 0.0;
  /// Called by the odometry thread; may be empty.
  daemon::ScanObserver observer{};
  /// Called about every 20 ms and after the end, to empty the pipeline's rings.
  std::function<void(daemon::Pipeline&)> drain{};
};

/// Runs niliod's pipeline as fast as possible over the beginning of a recording. True if the recording is
/// longer.
core::Result<bool> replay_drive(const daemon::Config& config, daemon::Input input, const DriveReplay& replay);

}  // namespace nilio::tools::inspect
