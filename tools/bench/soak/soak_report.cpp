#include "tools/bench/soak/soak.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace nilio::tools::bench {

namespace {

constexpr std::size_t kMinSamples = 10;
constexpr double kMebibyteKib = 1024.0;

std::string counts(const SoakResult& r) {
  return std::to_string(r.states[1]) + " / " + std::to_string(r.states[2]) + " / " +
         std::to_string(r.states[3]);
}

std::vector<const MemorySeries*> series_of(const SoakResult& result) {
  std::vector<const MemorySeries*> series{&result.pipeline};
  if (result.publisher) series.push_back(&*result.publisher);
  return series;
}

/// Number of poses in the latency histograms: "900", or "899 to 900" when stages differ.
std::string recorded_text(const SoakResult& result) {
  std::uint64_t minimum = result.poses;
  std::uint64_t maximum = 0;
  for (const auto& [stage, count] : result.recorded) {
    minimum = std::min(minimum, count);
    maximum = std::max(maximum, count);
  }
  return minimum == maximum ? std::to_string(minimum)
                            : std::to_string(minimum) + " to " + std::to_string(maximum);
}

std::string centimetres(double metres) { return metres > 0.0 ? fixed(100.0 * metres, 2) : "-"; }

}  // namespace

bool is_level(const MemorySeries& series) {
  const LineFit& fit = series.fit;
  if (fit.samples < kMinSamples) return false;
  if (std::abs(fit.rise) <= kTwoPagesRiseKib) return true;
  const double minutes = series.minutes.back() - series.minutes[series.minutes.size() - fit.samples];
  const bool is_short = minutes * kMaxGrowthKibPerMinute < kTwoPagesRiseKib;
  return fit.is_level() && (is_short || std::abs(fit.slope) < kMaxGrowthKibPerMinute);
}

std::vector<std::string> find_faults(const SoakResult& result) {
  std::vector<std::string> faults;
  for (const MemorySeries* series : series_of(result)) {
    if (is_level(*series)) continue;
    if (series->fit.samples < kMinSamples) {
      faults.push_back(series->name + ": " + std::to_string(series->fit.samples) +
                       " samples of its memory after the warm-up are too few - play more minutes");
      continue;
    }
    faults.push_back(series->name + ": memory changes by " + fixed(series->fit.slope, 3) + " +- " +
                     fixed(series->fit.standard_error, 3) + " KiB a minute over " +
                     std::to_string(series->fit.samples) + " samples");
  }
  if (result.poses != result.scans)
    faults.push_back(std::to_string(result.scans) + " scans gave " + std::to_string(result.poses) + " poses");
  for (const auto& [stage, count] : result.recorded) {
    // The end of the recording completes the last scan, which then has no reception stamp.
    if (count > result.poses || count + 1 < result.poses)
      faults.push_back("the histogram of " + stage + " has " + std::to_string(count) + " of " +
                       std::to_string(result.poses) + " poses");
  }
  if (result.max_minute_m >= kMaxDriftM)
    faults.push_back("stationary: the mean position of a minute is " + centimetres(result.max_minute_m) +
                     " cm from that of the first");
  if (result.packets_dropped > 0)
    faults.push_back(std::to_string(result.packets_dropped) + " packets of the recording were dropped");
  if (result.publisher_restarts > 0)
    faults.push_back("nilio-publisher was restarted " + std::to_string(result.publisher_restarts) + " times");
  return faults;
}

Table soak_table(std::span<const NamedSoak> runs) {
  Table table{
      {"run", "recorded min", "laps", "wall s", "scans", "poses", "tracking / degraded / lost", "with IMU",
       "in each histogram", "map voxels", "not published", "max. pose cm", "max. minute cm"},
      {}};
  for (const auto& [name, r] : runs) {
    table.rows.push_back({name, fixed(r.recorded_minutes, 1), std::to_string(r.laps),
                          fixed(r.wall_seconds, 0), std::to_string(r.scans), std::to_string(r.poses),
                          counts(r), std::to_string(r.scans_with_imu), recorded_text(r),
                          std::to_string(r.map_voxels), std::to_string(r.publisher_dropped),
                          centimetres(r.max_pose_m), centimetres(r.max_minute_m)});
  }
  return table;
}

Table soak_memory_table(std::span<const NamedSoak> runs) {
  Table table{{"run", "process", "after warm-up MiB", "maximum MiB", "end MiB", "slope KiB/min",
               "standard error", "rise KiB", "samples", "verdict"},
              {}};
  for (const auto& [name, result] : runs) {
    for (const MemorySeries* series : series_of(result)) {
      const std::vector<double>& kib = series->kib;
      if (kib.empty()) continue;
      const LineFit& fit = series->fit;
      table.rows.push_back({name, series->name,
                            fixed(kib[kib.size() - std::max<std::size_t>(fit.samples, 1)] / kMebibyteKib, 2),
                            fixed(*std::max_element(kib.begin(), kib.end()) / kMebibyteKib, 2),
                            fixed(kib.back() / kMebibyteKib, 2), fixed(fit.slope, 4),
                            fixed(fit.standard_error, 4), fixed(fit.rise, 1), std::to_string(fit.samples),
                            series->fit.samples < kMinSamples ? "too few samples"
                            : is_level(*series)               ? "level"
                                                              : "GROWS"});
    }
  }
  return table;
}

plot::Figure memory_figure(std::span<const NamedSoak> runs) {
  plot::Panel chart;
  chart.x.label = "recorded time [min]";
  chart.y.label = "anonymous resident memory [MiB]";
  for (const auto& [name, result] : runs) {
    for (const MemorySeries* series : series_of(result)) {
      plot::Curve curve{name + ", " + series->name, {}};
      for (std::size_t i = 0; i < series->kib.size(); ++i)
        curve.points.emplace_back(series->minutes[i], series->kib[i] / kMebibyteKib);
      if (chart.curves.size() < plot::kMaxCurves) chart.curves.push_back(std::move(curve));
    }
  }
  return {{std::move(chart)}};
}

}  // namespace nilio::tools::bench
