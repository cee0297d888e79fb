#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

namespace nilio::drivers {

/// Saves the lasers in the YAML form of the ROS Velodyne driver. with_calibration_file() gets exactly the
/// same numbers back. The file is replaced at once or not at all; an error names the file.
core::Result<std::monostate> write_calibration_yaml(const VelodyneSensor& sensor, const std::string& path);

/// Ids of the lasers that their calibration file switches off, ascending, for telling the user.
std::vector<std::uint16_t> disabled_lasers(const VelodyneSensor& sensor);

}  // namespace nilio::drivers
