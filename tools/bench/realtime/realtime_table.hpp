#pragma once

#include "tools/bench/odometry/table.hpp"
#include "tools/bench/realtime/realtime_run.hpp"
#include "tools/plot/chart.hpp"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools {

/// One row of the table: a budget and a condition, and what came of it.
struct RealtimeCell {
  /// Nothing: the configured one.
  std::optional<double> budget_ms;
  Condition condition = Condition::kIdle;
  Feed feed = Feed::kUdp;
  RealtimeRun run;
  std::optional<double> translation_percent;
};

/// A replay whose budget is counted in operations: no clock, so the same on every computer.
struct CountedRun {
  double budget_ms = 0.0;
  RunFigures figures;
  std::optional<double> translation_percent;
};

/// "hogs" or, with the files instead of the socket, "hogs, --as-live".
std::string condition_text(const RealtimeCell& cell);
/// "20" or, of the configured budget, "40 (default)".
std::string budget_text(const RealtimeCell& cell);
/// "20 ms, hogs": both of them.
std::string run_text(const RealtimeCell& cell);
/// "148/2/0/0/0", in the order of `counts`; "-" for none.
std::string counts_text(const NamedCounts& counts);
/// "1.20 / 3.40", in the unit of `scale` microseconds; "-" for nothing or no values.
std::string p50_p99(const std::optional<ipc::LatencySummary>& summary, double scale_us, int digits);

/// Scans, packets and rungs.
BenchTable realtime_work_table(std::span<const RealtimeCell> cells);
/// Times and noise.
BenchTable realtime_time_table(std::span<const RealtimeCell> cells);
/// SHA-256 of each trajectory in full, and its error.
BenchTable realtime_trajectory_table(std::span<const RealtimeCell> cells);
/// What real-time threads did that they must not do, by thread; without rows when nobody watched them.
BenchTable realtime_watch_table(std::span<const RealtimeCell> cells);
BenchTable counted_table(std::span<const CountedRun> runs);

/// Error against the budget, of the counted runs and of the idle ones in real time.
Chart accuracy_chart(std::span<const CountedRun> counted, std::span<const RealtimeCell> cells);
/// Percentiles of the time from the last packet to the pose handed over, a curve a row.
Chart latency_chart(std::span<const RealtimeCell> cells);

}  // namespace nilio::tools
