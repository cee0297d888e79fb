#pragma once

#include "tools/bench/odometry/measure.hpp"
#include "tools/plot/canvas.hpp"

#include <span>

namespace nilio::tools {

/// Left the median time of each stage, stacked, with the 99 % quantile and the most of the sum; right the
/// share of scans that took at most so long, for the first run of each method.
void draw_latency(Canvas& canvas, std::span<const Measurement> measurements);

}  // namespace nilio::tools
