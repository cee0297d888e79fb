#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/bench.hpp"
#include "tools/bench/common/sensor_drive.hpp"
#include "tools/bench/soak/soak_run.hpp"
#include "tools/common/system.hpp"
#include "tools/plot/figure.hpp"

#include <span>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// Limit of memory growth: 1.4 MiB a day.
inline constexpr double kMaxGrowthKibPerMinute = 1.0;

/// Rise of the fitted line that counts as level. Memory comes in pages of 4 KiB, and one page taken at any
/// time raises the line by up to one and a half of them. Two pages (a heap that grows a little, a part of the
/// map that was not used before) cannot be distinguished from level memory.
inline constexpr double kTwoPagesRiseKib = 12.0;

/// Limit for a stationary vehicle: distance of the mean position of a minute from that of the first minute.
inline constexpr double kMaxDriftM = 0.01;

/// A run and its name: "moving", "stationary".
struct NamedSoak {
  std::string name;
  SoakResult result;
};

/// True when the memory does not grow after the warm-up. The line through the samples has to rise by at most
/// kTwoPagesRiseKib, or its slope has to be zero within twice its standard error and below
/// kMaxGrowthKibPerMinute; the latter only for runs long enough to distinguish it from two pages (twelve
/// minutes). False with fewer than ten samples.
bool is_level(const MemorySeries& series);

/// Failed requirements of a run, one line each.
std::vector<std::string> find_faults(const SoakResult& result);

Table soak_table(std::span<const NamedSoak> runs);
Table soak_memory_table(std::span<const NamedSoak> runs);
plot::Figure memory_figure(std::span<const NamedSoak> runs);

/// Plays the drives, each LiDAR model in a loop of its own, then a simulated standstill. Adds tables, a
/// figure and the verdict to the page. Returns false when a requirement failed; fails when something could
/// not be run.
core::Result<bool> add_soak(std::span<const SensorDrive> drives, const SoakPlan& plan, StopSignals& signals,
                            ResultsPage& page);

}  // namespace nilio::tools::bench
