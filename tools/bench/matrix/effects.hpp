#pragma once

#include "tools/bench/matrix/result.hpp"
#include "tools/bench/matrix/row.hpp"
#include "tools/bench/report/results_page.hpp"

#include <string>

namespace nilio::tools::bench {

/// The town ideal, with each effect of realism alone, and with all of them: the same seeds, so that runs are
/// paired. With and without an IMU, for two sensors.
Matrix effects_matrix();

/// Drift and success by effect for one sensor, with the paired ratio to the ideal drives.
Table effects_table(const MatrixResult& result, const std::string& sensor);

}  // namespace nilio::tools::bench
