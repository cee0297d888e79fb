#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/odometry/measure.hpp"

#include <string>
#include <vector>

namespace nilio::tools {

/// The Point Cloud Library's NDT and ICP on the very scans that the odometry registers under `overrides`,
/// deskewed and thinned by it, in the same process and thread: against the scan before and against a map of
/// the ten before. An error when nilio was built without PCL.
core::Result<std::vector<Measurement>> measure_pcl(const BenchDataset& dataset,
                                                   const std::vector<std::string>& overrides);

}  // namespace nilio::tools
