#pragma once

#include "nilio/core/result.hpp"

#include "tools/plot/figure.hpp"

#include <string>
#include <vector>

#include <Eigen/Core>

namespace nilio::tools::plot {

/// Reads the points of a map: .ply (binary little-endian with x, y, z as float or double) or .xyz (text,
/// the first three numbers of each line). Points that are not finite are left out. Errors name the file, and
/// in text the line.
core::Result<std::vector<Eigen::Vector3f>> read_map_points(const std::string& path);

/// Map points (x, y, height) on the pixels of `axes`: colour by height, opacity by density.
Raster rasterise_map(const std::vector<Eigen::Vector3f>& points, const Axes& axes);

}  // namespace nilio::tools::plot
