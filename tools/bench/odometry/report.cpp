#include "tools/bench/odometry/report.hpp"

#include "tools/bench/common/memory_use.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace nilio::tools::bench {

namespace {

constexpr double kMebibyte = 1024.0 * 1024.0;

std::string translation(const std::optional<evaluate::SegmentError>& segment) {
  return segment ? fixed(segment->translation_percent, 3) : "-";
}

std::string rotation(const std::optional<evaluate::SegmentError>& segment) {
  return segment ? fixed(segment->rotation_deg_per_100m, 3) : "-";
}

/// "2.31 / 4.90 / 7.12".
std::string three(const Percentiles& spread) {
  return fixed(spread.median, 2) + " / " + fixed(spread.p99, 2) + " / " + fixed(spread.maximum, 2);
}

/// "62, 33": maximum of the process, and its memory before the run.
std::string memory_text(const Measurement& m) {
  if (m.peak_resident_bytes == 0) return "-";
  const auto mebibytes = [](std::uint64_t bytes) { return fixed(static_cast<double>(bytes) / kMebibyte, 0); };
  return mebibytes(m.peak_resident_bytes) + ", " + mebibytes(m.resident_before_bytes);
}

}  // namespace

Table accuracy_table(std::span<const Measurement> measurements) {
  Table table{{"registration", "t %, 10-80 m", "r deg/100 m", "t %, 100-800 m", "r deg/100 m", "APE m",
               "RPE cm", "RPE deg", "path m", "of the truth"},
              {}};
  for (const Measurement& m : measurements) {
    if (!table.rows.empty() && table.rows.back().front() == m.name) continue;
    const Accuracy& a = m.accuracy;
    const double share = 100.0 * a.estimate_length_m / a.truth_length_m;
    table.rows.push_back({m.name, translation(a.near), rotation(a.near), translation(a.far), rotation(a.far),
                          fixed(a.ape_m, 3), fixed(100.0 * a.rpe_m, 2), fixed(a.rpe_deg, 3),
                          fixed(a.estimate_length_m, 1),
                          a.truth_length_m > 0.0 ? fixed(share, 2) + " %" : "-"});
  }
  return table;
}

Table consistency_table(std::span<const Measurement> measurements) {
  Table table{{"registration", "steps", "NEES, step", "inside 95 %", "NEES, ten steps", "inside 95 %",
               "NEES, twist", "inside 95 %"},
              {}};
  for (const Measurement& m : measurements) {
    const Consistency& c = m.consistency;
    if (c.step.count == 0 || (!table.rows.empty() && table.rows.back().front() == m.name)) continue;
    std::vector<std::string> row{m.name, std::to_string(c.step.count)};
    for (const Nees& nees : {c.step, c.second, c.twist}) {
      row.push_back(fixed(nees.mean, 2));
      row.push_back(fixed(100.0 * nees.within_95, 1) + " %");
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

Table cost_table(std::span<const Measurement> measurements) {
  Table table{
      {"registration", "CPU ms/scan", "CPU with decoding", "wall ms/scan", "peak memory MiB, before",
       "allocations, first " + std::to_string(kWarmUpScans) + " scans", "allocations/scan afterwards"},
      {}};
  for (const Measurement& m : measurements) {
    const bool counted = allocations_are_counted() && m.work.scans > 0;
    table.rows.push_back(
        {label_of(m), three(m.cpu.total), m.threads == 1 && m.work.scans > 0 ? three(m.cpu.with_feed) : "-",
         three(m.wall.total), memory_text(m), counted ? std::to_string(m.allocations_warming_up) : "-",
         counted ? fixed(m.allocations_per_scan, 2) : "-"});
  }
  return table;
}

Table stage_table(std::span<const Measurement> measurements) {
  Table table{{"registration"}, {}};
  for (std::size_t s = 0; s < kStages; ++s) table.headings.push_back(stage_name(s) + std::string(" CPU ms"));
  for (std::size_t s = 0; s < kStages; ++s) table.headings.push_back(stage_name(s) + std::string(" wall ms"));
  for (const Measurement& m : measurements) {
    std::vector<std::string> row{label_of(m)};
    for (const Percentiles& stage : m.cpu.stages) row.push_back(three(stage));
    for (const Percentiles& stage : m.wall.stages) row.push_back(three(stage));
    table.rows.push_back(std::move(row));
  }
  return table;
}

Table work_table(std::span<const Measurement> measurements) {
  Table table{{"registration", "scans", "with IMU", "rejected", "points", "filtered", "used", "matched",
               "passes", "coarse it.", "fine it.", "map voxels"},
              {}};
  for (const Measurement& m : measurements) {
    const WorkCounts& w = m.work;
    if (w.scans == 0) continue;
    table.rows.push_back({label_of(m), std::to_string(w.scans), std::to_string(w.with_imu),
                          std::to_string(w.predicted), fixed(w.points, 0), fixed(w.points_filtered, 0),
                          fixed(w.points_used, 0), fixed(w.correspondences, 0), fixed(w.passes, 2),
                          fixed(w.coarse_iterations, 2), fixed(w.fine_iterations, 2),
                          fixed(w.map_voxels, 0)});
  }
  return table;
}

Table hash_table(std::span<const Measurement> measurements) {
  Table table{{"registration", "threads", "SHA-256 of trajectory.tum"}, {}};
  for (const Measurement& m : measurements) {
    if (!m.sha256.empty()) table.rows.push_back({m.name, std::to_string(m.threads), m.sha256});
  }
  return table;
}

Table pcl_table(const Measurement& own, std::span<const Measurement> pcl) {
  Table table{
      {"", "CPU ms/scan", "times " + label_of(own), "times its registration", "t %, 10-80 m", "RPE cm"}, {}};
  const double registration = own.cpu.stages[kCoarseStage].median + own.cpu.stages[kFineStage].median;
  const auto add_row = [&](const Measurement& m) {
    const double ms = m.cpu.total.median;
    table.rows.push_back({label_of(m), fixed(ms, 2), fixed(ms / own.cpu.total.median, 1),
                          fixed(ms / registration, 1), translation(m.accuracy.near),
                          fixed(100.0 * m.accuracy.rpe_m, 2)});
  };
  if (pcl.empty()) return table;
  add_row(own);
  for (const Measurement& m : pcl) add_row(m);
  return table;
}

Table ablation_table(std::span<const AblationRow> rows) {
  Table table{{"change", "setting", "t %, 10-80 m", "t %, 100-800 m", "r deg/100 m", "RPE cm", "RPE deg",
               "rejected", "CPU ms"},
              {}};
  for (const auto& [change, setting, m] : rows) {
    const Accuracy& a = m.accuracy;
    table.rows.push_back({change, setting, translation(a.near), translation(a.far), rotation(a.near),
                          fixed(100.0 * a.rpe_m, 2), fixed(a.rpe_deg, 3), std::to_string(m.work.predicted),
                          fixed(m.cpu.total.median, 2)});
  }
  return table;
}

plot::Figure latency_figure(std::span<const Measurement> measurements) {
  plot::Panel stages;
  stages.x.label = "stage";
  for (std::size_t s = 0; s < kStages; ++s)
    stages.x.ticks.emplace_back(static_cast<double>(s), stage_name(s));
  stages.y = {"median wall time [ms]", false, true};
  stages.markers = true;
  plot::Panel scans;
  scans.x.label = "percentile of the scans";
  scans.x.ticks = {{0.0, "0"}, {1.0, "90"}, {2.0, "99"}, {3.0, "99.9"}};
  scans.x.ticks.emplace_back(std::log10(2.0), "50");
  scans.y = {"wall time of a scan [ms]", true};
  std::string last;
  for (const Measurement& m : measurements) {
    if (std::exchange(last, m.name) == m.name || scans.curves.size() == plot::kMaxCurves) continue;
    plot::Curve curve{m.name, {}};
    std::vector<double> sorted = m.wall.per_scan;
    std::sort(sorted.begin(), sorted.end());
    const auto count = static_cast<double>(sorted.size());
    // The tail is spread out: -log10 of the share of slower scans.
    for (std::size_t k = 0; k < sorted.size(); ++k)
      curve.points.emplace_back(-std::log10(1.0 - static_cast<double>(k) / count), sorted[k]);
    scans.curves.push_back(std::move(curve));
    if (m.work.scans == 0) continue;
    plot::Curve medians{m.name, {}};
    for (std::size_t s = 0; s < kStages; ++s)
      medians.points.emplace_back(static_cast<double>(s), m.wall.stages[s].median);
    stages.curves.push_back(std::move(medians));
  }
  return {{std::move(stages), std::move(scans)}};
}

}  // namespace nilio::tools::bench
