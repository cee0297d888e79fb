#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/common/sensor_drive.hpp"
#include "tools/bench/results_page.hpp"
#include "tools/bench/soak/soak_report.hpp"
#include "tools/common/stop_signals.hpp"

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools {

struct SoakPlan {
  /// Of recorded time, driving and standing; 0 = not.
  double minutes = 0.0;
  double standing_minutes = 0.0;
  /// Of the time; memory is judged after it.
  double warm_up_share = 0.25;
  std::vector<std::string> overrides;
  std::uint32_t domain = 0;
};

/// Plays the drives, of each LiDAR model in a loop of its own, then simulates standing, and puts tables, a
/// picture and faults on the page. True when nothing is wrong. Fails when something could not be run.
core::Result<bool> add_soak(std::span<const SensorDrive> drives, const SoakPlan& plan, StopSignals& signals,
                            ResultsPage& page);

}  // namespace nilio::tools
