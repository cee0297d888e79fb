#include "tools/bench/realtime/realtime_table.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <limits>

namespace nilio::tools {

namespace {

constexpr double kMillisecondUs = 1000.0;
/// Where the tail shows: -log10(1 - share).
constexpr std::array<std::pair<double, const char*>, 5> kPercentiles{
    {{0.30103, "50 %"}, {1.0, "90 %"}, {2.0, "99 %"}, {3.0, "99.9 %"}, {3.5, "most"}}};

std::string whole(std::uint64_t count) { return std::to_string(count); }

std::string number_text(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%g", value);
  return text.data();
}

std::string p50_p99_max(const std::optional<ipc::LatencySummary>& summary, double scale_us, int digits) {
  if (!summary || summary->count == 0) return "-";
  return p50_p99(summary, scale_us, digits) + " / " + fixed(summary->max_us / scale_us, digits);
}

std::string percent_text(const std::optional<double>& percent) { return percent ? fixed(*percent, 3) : "-"; }

std::string names_of(const NamedCounts& counts) {
  std::string text;
  for (const auto& [name, count] : counts) text += (text.empty() ? "" : "/") + name;
  return text;
}

/// The rungs' names in a heading; empty runs have none.
template <class Run, class Figures>
std::string rung_heading(std::span<const Run> runs, const Figures& figures_of) {
  for (const Run& run : runs) {
    if (const std::string names = names_of(figures_of(run).rungs); !names.empty()) return names;
  }
  return "rungs";
}

/// "0" or "allocation 1, lock 2".
std::string offences_text(const NamedCounts& counts) {
  std::string text;
  for (const auto& [name, count] : counts) {
    if (count > 0) text += (text.empty() ? "" : ", ") + name + " " + std::to_string(count);
  }
  return text.empty() ? "0" : text;
}

/// The largest y is more than ten times the smallest.
bool spreads_over_decades(std::span<const PlotCurve> curves) {
  double least = std::numeric_limits<double>::infinity();
  double most = 0.0;
  for (const PlotCurve& curve : curves) {
    for (const Eigen::Vector2d& point : curve.points) {
      least = std::min(least, point.y());
      most = std::max(most, point.y());
    }
  }
  return most > 10.0 * least;
}

}  // namespace

std::string condition_text(const RealtimeCell& cell) {
  return std::string(condition_name(cell.condition)) + (cell.feed == Feed::kReplay ? ", --as-live" : "");
}

std::string budget_text(const RealtimeCell& cell) {
  const std::optional<double>& actual = cell.run.figures.budget_ms;
  if (cell.budget_ms) return number_text(*cell.budget_ms);
  return actual ? number_text(*actual) + " (default)" : "default";
}

std::string counts_text(const NamedCounts& counts) {
  std::string text;
  for (const auto& [name, count] : counts) text += (text.empty() ? "" : "/") + std::to_string(count);
  return text.empty() ? "-" : text;
}

std::string p50_p99(const std::optional<ipc::LatencySummary>& summary, double scale_us, int digits) {
  if (!summary || summary->count == 0) return "-";
  return fixed(summary->p50_us / scale_us, digits) + " / " + fixed(summary->p99_us / scale_us, digits);
}

std::string run_text(const RealtimeCell& cell) { return budget_text(cell) + " ms, " + condition_text(cell); }

BenchTable realtime_work_table(std::span<const RealtimeCell> cells) {
  const auto figures_of = [](const RealtimeCell& cell) -> const RunFigures& { return cell.run.figures; };
  BenchTable table{{"budget ms", "condition", "scans", "poses", "packets sent", "received", "lost", "no room",
                    "superseded", rung_heading(cells, figures_of), "late poses", "with IMU"},
                   {}};
  for (const RealtimeCell& cell : cells) {
    const RunFigures& f = cell.run.figures;
    table.rows.push_back({budget_text(cell), condition_text(cell), whole(f.scans), whole(f.poses),
                          cell.run.sent ? whole(cell.run.sent->packets) : "-", whole(f.packets),
                          whole(f.packets_lost), whole(f.packets_dropped), whole(f.superseded),
                          counts_text(f.rungs), whole(f.late_poses), whole(f.scans_with_imu)});
  }
  return table;
}

BenchTable realtime_time_table(std::span<const RealtimeCell> cells) {
  BenchTable table{
      {"budget ms", "condition", "past the budget ms", "iteration us", "to hand-over ms", "to DDS ms",
       "to subscriber ms", "DDS alone us", "IMU pose us", "wake-up us", "sender late us"},
      {}};
  for (const RealtimeCell& cell : cells) {
    const RealtimeRun& run = cell.run;
    table.rows.push_back(
        {budget_text(cell), condition_text(cell), p50_p99_max(run.figures.overshoot, kMillisecondUs, 2),
         p50_p99(run.figures.iteration, 1.0, 0), p50_p99(run.figures.end_to_end, kMillisecondUs, 2),
         p50_p99(run.received_to_written, kMillisecondUs, 2),
         p50_p99(run.packet_to_subscriber, kMillisecondUs, 2), p50_p99(run.transport, 1.0, 0),
         p50_p99(run.imu_pose, 1.0, 0),
         fixed(run.noise.p99_us, 0) + " / " + fixed(run.noise.max_us, 0) +
             (run.noise_is_fifo ? "" : " (normal)"),
         run.sent ? fixed(static_cast<double>(run.sent->late_p99_ns) / kMillisecondUs, 0) : "-"});
  }
  return table;
}

BenchTable realtime_trajectory_table(std::span<const RealtimeCell> cells) {
  BenchTable table{{"budget ms", "condition", "t %, 10-80 m", "SHA-256"}, {}};
  for (const RealtimeCell& cell : cells)
    table.rows.push_back({budget_text(cell), condition_text(cell), percent_text(cell.translation_percent),
                          cell.run.figures.sha256});
  return table;
}

BenchTable realtime_watch_table(std::span<const RealtimeCell> cells) {
  BenchTable table{{"budget ms", "condition", "watched s"}, {}};
  for (const RealtimeCell& cell : cells) {
    if (!cell.run.watch) continue;
    const ThreadWatch& watch = *cell.run.watch;
    std::vector<std::string> row{budget_text(cell), condition_text(cell), fixed(watch.watched_s, 1)};
    const bool is_first = table.rows.empty();
    for (const ThreadWatch::Thread& thread : watch.threads) {
      if (is_first) table.headings.push_back(thread.name);
      row.push_back(thread.seen == 0 ? "-" : offences_text(thread.counts));
    }
    row.insert(row.end(), {whole(watch.workers), offences_text(watch.of_tbb)});
    table.rows.push_back(std::move(row));
  }
  table.headings.insert(table.headings.end(), {"workers", "by TBB for itself"});
  return table;
}

BenchTable counted_table(std::span<const CountedRun> runs) {
  const auto figures_of = [](const CountedRun& run) -> const RunFigures& { return run.figures; };
  BenchTable table{{"budget ms", "poses", rung_heading(runs, figures_of), "past the budget ms, counted",
                    "iteration us", "by the guard", "t %, 10-80 m", "SHA-256"},
                   {}};
  for (const CountedRun& run : runs)
    table.rows.push_back(
        {number_text(run.budget_ms), whole(run.figures.poses), counts_text(run.figures.rungs),
         p50_p99_max(run.figures.overshoot, kMillisecondUs, 2), p50_p99(run.figures.iteration, 1.0, 0),
         whole(run.figures.predicted_by_guard), percent_text(run.translation_percent), run.figures.sha256});
  return table;
}

Chart accuracy_chart(std::span<const CountedRun> counted, std::span<const RealtimeCell> cells) {
  Chart chart;
  chart.x = {"budget from the last packet to the pose [ms]", true, false, {}};
  chart.y = {"mean error over 10 to 80 m [%]", false, true, {}};
  chart.marked = true;
  PlotCurve operations{"counted operations", {}};
  for (const CountedRun& run : counted) {
    if (run.translation_percent) operations.points.emplace_back(run.budget_ms, *run.translation_percent);
  }
  PlotCurve wall{"in real time, idle", {}};
  for (const RealtimeCell& cell : cells) {
    if (cell.budget_ms && cell.translation_percent && cell.condition == Condition::kIdle)
      wall.points.emplace_back(*cell.budget_ms, *cell.translation_percent);
  }
  for (PlotCurve* const curve : {&operations, &wall}) {
    std::sort(curve->points.begin(), curve->points.end(),
              [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() < b.x(); });
    if (!curve->points.empty()) chart.curves.push_back(std::move(*curve));
  }
  // Errors that are nearly the same are to look it, beside zero.
  chart.y.logarithmic = spreads_over_decades(chart.curves);
  return chart;
}

Chart latency_chart(std::span<const RealtimeCell> cells) {
  Chart chart;
  chart.x.label = "share of poses that took at most so long";
  for (const auto& [at, text] : kPercentiles) chart.x.ticks.emplace_back(at, text);
  chart.y = {"last packet to pose handed over [ms]", true, false, {}};
  chart.marked = true;
  for (const RealtimeCell& cell : cells) {
    if (!cell.run.figures.end_to_end || cell.run.figures.end_to_end->count == 0) continue;
    const ipc::LatencySummary& s = *cell.run.figures.end_to_end;
    const std::array values{s.p50_us, s.p90_us, s.p99_us, s.p99_9_us, s.max_us};
    PlotCurve curve{run_text(cell), {}};
    for (std::size_t i = 0; i < values.size(); ++i)
      curve.points.emplace_back(kPercentiles[i].first, values[i] / kMillisecondUs);
    chart.curves.push_back(std::move(curve));
  }
  return chart;
}

}  // namespace nilio::tools
