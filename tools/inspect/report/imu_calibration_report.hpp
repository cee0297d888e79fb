#pragma once

#include "tools/inspect/drive.hpp"

#include <string>
#include <vector>

namespace nilio::tools {

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
std::string observed_text(const core::ImuCorrection& correction);

/// "[0, 90, -1.5]", rounded to what a mounting can be known to.
std::string numbers_text(const std::vector<double>& numbers);

}  // namespace nilio::tools
