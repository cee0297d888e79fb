#pragma once

#include "tools/bench/odometry/table.hpp"
#include "tools/bench/soak/soak_run.hpp"
#include "tools/plot/chart.hpp"

#include <span>
#include <string>
#include <vector>

namespace nilio::tools {

/// More is a leak worth looking for: 1.4 MiB a day.
inline constexpr double kMostGrowthKibPerMinute = 1.0;

/// A run under its name: "moving", "standing".
struct NamedSoak {
  std::string name;
  SoakResult result;
};

/// Memory comes in pages of 4 KiB, and one that is taken at any time lets the line rise by up to one and a
/// half. Two of them (a heap that reaches a little farther, a part of the map that was never used) are no
/// leak: what rises no more cannot be told from what is level. It is half a KiB a minute over half an hour.
inline constexpr double kTwoPagesRiseKib = 12.0;

/// Of a minute's mean, while the vehicle stands, from that of the first minute.
inline constexpr double kMostDriftM = 0.01;

/// Memory does not grow: after the warm-up it takes no more than two pages, or its slope is zero within twice
/// the standard error and below kMostGrowthKibPerMinute; that it is so slow cannot be asked of less than the
/// twelve minutes in which two pages make so much. At least ten samples have to say so.
bool is_level(const MemorySeries& series);

/// What is wrong with a run, one line each; empty for a good one.
std::vector<std::string> find_faults(const SoakResult& result);

BenchTable soak_table(std::span<const NamedSoak> runs);
BenchTable soak_memory_table(std::span<const NamedSoak> runs);
Chart memory_chart(std::span<const NamedSoak> runs);

}  // namespace nilio::tools
