#include "tools/bench/realtime/tables.hpp"

#include "tools/bench/odometry/measure.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <limits>
#include <utility>

namespace nilio::tools::bench {

namespace {

constexpr double kMillisecondUs = 1000.0;
/// -log10(1 - share), which spreads out the tail.
constexpr std::array<std::pair<double, const char*>, 5> kPercentiles{
    {{0.30103, "50 %"}, {1.0, "90 %"}, {2.0, "99 %"}, {3.0, "99.9 %"}, {3.5, "maximum"}}};

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

/// The degradation_levels' names in a heading; empty runs have none.
template <class Run, class Figures>
std::string level_heading(std::span<const Run> runs, const Figures& figures_of) {
  for (const Run& run : runs) {
    if (const std::string names = names_of(figures_of(run).degradation_levels); !names.empty()) return names;
  }
  return "levels";
}

/// "0" or "allocation 1, lock 2".
std::string calls_text(const NamedCounts& counts) {
  std::string text;
  for (const auto& [name, count] : counts) {
    if (count > 0) text += (text.empty() ? "" : ", ") + name + " " + std::to_string(count);
  }
  return text.empty() ? "0" : text;
}

std::string reader_latency(const RealtimeRun& run) {
  if (!run.reader) return "-";
  return p50_p99(run.reader->packet_to_reader, kMillisecondUs, 2) + (run.reader->is_fifo ? "" : " (normal)");
}

std::string reader_poses(const RealtimeRun& run) { return run.reader ? whole(run.reader->poses) : "-"; }

/// True when the largest y is more than ten times the smallest.
bool spreads_over_decades(std::span<const plot::Curve> curves) {
  double minimum = std::numeric_limits<double>::infinity();
  double maximum = 0.0;
  for (const plot::Curve& curve : curves) {
    for (const Eigen::Vector2d& point : curve.points) {
      minimum = std::min(minimum, point.y());
      maximum = std::max(maximum, point.y());
    }
  }
  return maximum > 10.0 * minimum;
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

Table realtime_work_table(std::span<const RealtimeCell> cells) {
  const auto figures_of = [](const RealtimeCell& cell) -> const NiliodFigures& { return cell.run.figures; };
  Table table{{"budget ms", "condition", "scans", "poses", "packets sent", "received", "lost", "dropped",
               "superseded", level_heading(cells, figures_of), "late poses", "with IMU"},
              {}};
  for (const RealtimeCell& cell : cells) {
    const NiliodFigures& f = cell.run.figures;
    // A run whose disk did not take the report has no counts.
    const auto counted = [&](auto count) { return f.budget_ms ? whole(count) : "-"; };
    table.rows.push_back({budget_text(cell), condition_text(cell), counted(f.scans), counted(f.poses),
                          cell.run.sent ? whole(cell.run.sent->packets) : "-", counted(f.packets),
                          counted(f.packets_lost), counted(f.packets_dropped), counted(f.superseded),
                          counts_text(f.degradation_levels), counted(f.late_poses),
                          counted(f.scans_with_imu)});
  }
  return table;
}

Table realtime_time_table(std::span<const RealtimeCell> cells) {
  Table table{{"budget ms", "condition", "beyond budget ms", "iteration us", "to publication ms", "to DDS ms",
               "to subscriber ms", "to reader ms", "reader's poses", "DDS us", "IMU pose us", "wake-up us",
               "sender delay us"},
              {}};
  for (const RealtimeCell& cell : cells) {
    const RealtimeRun& run = cell.run;
    table.rows.push_back(
        {budget_text(cell), condition_text(cell), p50_p99_max(run.figures.overshoot, kMillisecondUs, 2),
         p50_p99(run.figures.iteration, 1.0, 0), p50_p99(run.figures.end_to_end, kMillisecondUs, 2),
         p50_p99(run.received_to_written, kMillisecondUs, 2),
         p50_p99(run.packet_to_subscriber, kMillisecondUs, 2), reader_latency(run), reader_poses(run),
         p50_p99(run.transport, 1.0, 0), p50_p99(run.imu_pose, 1.0, 0),
         fixed(run.wakeup.p99_us, 0) + " / " + fixed(run.wakeup.max_us, 0) +
             (run.wakeup_is_fifo ? "" : " (normal)"),
         run.sent ? fixed(static_cast<double>(run.sent->late_p99_ns) / kMillisecondUs, 0) : "-"});
  }
  return table;
}

Table realtime_trajectory_table(std::span<const RealtimeCell> cells) {
  Table table{{"budget ms", "condition", "t %, 10-80 m", "SHA-256"}, {}};
  for (const RealtimeCell& cell : cells)
    table.rows.push_back({budget_text(cell), condition_text(cell), percent_text(cell.translation_percent),
                          cell.run.figures.sha256});
  return table;
}

Table realtime_watch_table(std::span<const RealtimeCell> cells) {
  Table table{{"budget ms", "condition", "watched s"}, {}};
  for (const RealtimeCell& cell : cells) {
    if (!cell.run.watch) continue;
    const ThreadWatch& watch = *cell.run.watch;
    std::vector<std::string> row{budget_text(cell), condition_text(cell), fixed(watch.watched_s, 1)};
    const bool is_first = table.rows.empty();
    for (const ThreadWatch::Thread& thread : watch.threads) {
      if (is_first) table.headings.push_back(thread.name);
      row.push_back(thread.seen == 0 ? "-" : calls_text(thread.counts));
    }
    row.insert(row.end(), {whole(watch.workers), calls_text(watch.of_tbb)});
    table.rows.push_back(std::move(row));
  }
  table.headings.insert(table.headings.end(), {"workers", "inside TBB"});
  return table;
}

Table counted_table(std::span<const CountedRun> runs) {
  const auto figures_of = [](const CountedRun& run) -> const NiliodFigures& { return run.figures; };
  Table table{{"budget ms", "poses", level_heading(runs, figures_of), "beyond budget ms, counted",
               "iteration us", "predicted by guard", "t %, 10-80 m", "SHA-256"},
              {}};
  for (const CountedRun& run : runs)
    table.rows.push_back(
        {number_text(run.budget_ms), whole(run.figures.poses), counts_text(run.figures.degradation_levels),
         p50_p99_max(run.figures.overshoot, kMillisecondUs, 2), p50_p99(run.figures.iteration, 1.0, 0),
         whole(run.figures.predicted_by_guard), percent_text(run.translation_percent), run.figures.sha256});
  return table;
}

plot::Figure accuracy_figure(std::span<const CountedRun> counted, std::span<const RealtimeCell> cells) {
  plot::Panel chart;
  chart.x = {"budget from the last packet to the pose [ms]", true};
  chart.y = {"mean error over 10 to 80 m [%]", false, true};
  chart.markers = true;
  plot::Curve operations{"counted operations", {}};
  for (const CountedRun& run : counted) {
    if (run.translation_percent) operations.points.emplace_back(run.budget_ms, *run.translation_percent);
  }
  plot::Curve wall{"live, idle", {}};
  for (const RealtimeCell& cell : cells) {
    if (cell.budget_ms && cell.translation_percent && cell.condition == Condition::kIdle)
      wall.points.emplace_back(*cell.budget_ms, *cell.translation_percent);
  }
  for (plot::Curve* const curve : {&operations, &wall}) {
    std::sort(curve->points.begin(), curve->points.end(),
              [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() < b.x(); });
    if (!curve->points.empty()) chart.curves.push_back(std::move(*curve));
  }
  // Linear from zero where the errors differ little.
  chart.y.logarithmic = spreads_over_decades(chart.curves);
  return {{std::move(chart)}};
}

plot::Figure realtime_latency_figure(std::span<const RealtimeCell> cells) {
  plot::Panel chart;
  chart.x.label = "percentile of the poses";
  for (const auto& [at, text] : kPercentiles) chart.x.ticks.emplace_back(at, text);
  chart.y = {"last packet to published pose [ms]", true};
  chart.markers = true;
  const auto add = [&chart](const RealtimeCell& cell) {
    if (!cell.run.figures.end_to_end || cell.run.figures.end_to_end->count == 0) return;
    if (chart.curves.size() == plot::kMaxCurves) return;
    const ipc::LatencySummary& s = *cell.run.figures.end_to_end;
    const std::array values{s.p50_us, s.p90_us, s.p99_us, s.p99_9_us, s.max_us};
    plot::Curve curve{run_text(cell), {}};
    for (std::size_t i = 0; i < values.size(); ++i)
      curve.points.emplace_back(kPercentiles[i].first, values[i] / kMillisecondUs);
    chart.curves.push_back(std::move(curve));
  };
  for (const RealtimeCell& cell : cells) {
    if (!cell.budget_ms) add(cell);
  }
  for (const RealtimeCell& cell : cells) {
    if (cell.budget_ms && cell.condition == Condition::kIdle) add(cell);
  }
  return {{std::move(chart)}};
}

std::optional<double> translation_error_percent(const std::optional<Trajectory>& truth, Trajectory estimate,
                                                core::Duration shift) {
  if (!truth || estimate.poses.size() < 2) return std::nullopt;
  for (core::Time& stamp : estimate.stamps) stamp = stamp + shift;
  const core::Result<Accuracy> accuracy = measure_accuracy(*truth, estimate);
  if (!accuracy || !accuracy->near) return std::nullopt;
  return accuracy->near->translation_percent;
}

}  // namespace nilio::tools::bench
