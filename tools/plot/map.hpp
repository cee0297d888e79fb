#pragma once

#include "nilio/core/result.hpp"

#include <string>
#include <vector>

#include <Eigen/Core>

namespace nilio::tools {

/// Reads the points of a map: .ply (binary little-endian with x, y, z as float or double) or .xyz (text,
/// first three numbers of a line). Points that are not finite are left out. Errors name the file, and the
/// line in text.
core::Result<std::vector<Eigen::Vector3f>> read_map_points(const std::string& path);

}  // namespace nilio::tools
