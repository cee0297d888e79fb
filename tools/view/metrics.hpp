#pragma once

#include "tools/view/live_state.hpp"
#include "tools/view/server.hpp"

#include <array>
#include <string>

namespace nilio::tools::view {

/// Upper bounds of the buckets of nilio_stage_seconds, in microseconds. Part of the interface: old and new
/// buckets cannot be added up.
inline constexpr std::array<double, 22> kStageBoundsUs{
    50,    100,   200,   500,   1000,  2000,  3000, 5000,  7500, 10000, 15000,
    20000, 30000, 40000, 50000, 65000, 80000, 1e5,  1.5e5, 2e5,  5e5,   1'000'000};

enum class MetricsFormat {
  kPrometheus,   ///< text 0.0.4
  kOpenMetrics,  ///< 1.0.0
};

/// The format to answer a request with this Accept header.
MetricsFormat metrics_format(std::string_view accept);
const char* content_type_of(MetricsFormat format);

/// All metrics of a live nilio and of this program. Counters exist from the start. While no pose comes, the
/// gauges of the drive are left out: a value that stands still is none. Names: docs/view.md.
std::string metrics_text(const LiveState& state, const ServerCounts& server, std::size_t map_points,
                         MetricsFormat format);

}  // namespace nilio::tools::view
