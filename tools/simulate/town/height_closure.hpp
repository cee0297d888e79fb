#pragma once

#include "nilio/core/se3.hpp"

#include <vector>

namespace nilio::tools::simulation {

/// Gives a drive the same height wherever it comes to the same place again. Recorded heights drift by metres
/// from one pass to the next, and there is only one ground. The correction of each pass is spread over the
/// whole drive by least squares, so that slopes change by tenths of a percent; only heights change.
void close_heights(std::vector<core::SE3>& poses);

}  // namespace nilio::tools::simulation
