#pragma once

#include "tools/bench/realtime/live_run.hpp"
#include "tools/bench/report/results_page.hpp"
#include "tools/plot/figure.hpp"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// A live run under a budget and a condition: one row of the tables.
struct RealtimeCell {
  std::optional<double> budget_ms;  ///< empty = the configured one
  Condition condition = Condition::kIdle;
  Feed feed = Feed::kUdp;
  RealtimeRun run;
  std::optional<double> translation_percent;
};

/// Mean translation error of the whole computation: a replay without a deadline.
struct AccuracyReference {
  std::optional<double> udp;     ///< without an IMU where its frames are not sent
  std::optional<double> replay;  ///< of the files
};

/// A replay whose budget is counted in operations instead of time: the same on every computer.
struct CountedRun {
  double budget_ms = 0.0;
  NiliodFigures figures;
  std::optional<double> translation_percent;
};

/// "cpu" or, with the files instead of the socket, "cpu, --as-live".
std::string condition_text(const RealtimeCell& cell);
/// "20" or, for the configured budget, "40 (default)".
std::string budget_text(const RealtimeCell& cell);
/// "20 ms, cpu".
std::string run_text(const RealtimeCell& cell);
/// Mean translation error over segments of 10 to 80 m, percent; empty for a shorter path or without a truth.
/// `shift` is added to the estimate's stamps.
std::optional<double> translation_error_percent(const std::optional<Trajectory>& truth, Trajectory estimate,
                                                core::Duration shift);
/// "148/2/0/0/0", in the order of `counts`; "-" for none.
std::string counts_text(const NamedCounts& counts);
/// "1.20 / 3.40", in units of `scale_us` microseconds; "-" without values.
std::string p50_p99(const std::optional<ipc::LatencySummary>& summary, double scale_us, int digits);

/// Scans, packets and degradation_levels.
Table realtime_work_table(std::span<const RealtimeCell> cells);
/// Latencies and wake-up latency. Reader: the independent one.
Table realtime_time_table(std::span<const RealtimeCell> cells);
/// SHA-256 of each trajectory, and its error.
Table realtime_trajectory_table(std::span<const RealtimeCell> cells);
/// Forbidden calls of each real-time thread; without rows when they were not counted.
Table realtime_watch_table(std::span<const RealtimeCell> cells);
Table counted_table(std::span<const CountedRun> runs);

/// Error over the budget, for the counted runs and the live ones on an idle computer.
plot::Figure accuracy_figure(std::span<const CountedRun> counted, std::span<const RealtimeCell> cells);
/// Percentiles of the latency from the last packet to the published pose. At most as many runs as a panel
/// takes: those under the configured budget first, then those on an idle computer.
plot::Figure realtime_latency_figure(std::span<const RealtimeCell> cells);

}  // namespace nilio::tools::bench
