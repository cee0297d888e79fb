#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/odometry/run.hpp"
#include "tools/bench/odometry/table.hpp"

#include <string>
#include <vector>

namespace nilio::tools {

/// Accuracy and CPU time with one choice of the default configuration changed at a time. A choice that makes
/// no difference to a data set, such as the IMU where there is none, is left out.
core::Result<BenchTable> ablation_table(const BenchDataset& dataset,
                                        const std::vector<std::string>& overrides);

}  // namespace nilio::tools
