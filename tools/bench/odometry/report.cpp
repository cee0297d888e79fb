#include "tools/bench/odometry/report.hpp"

#include "tools/bench/common/allocation_count.hpp"

#include <array>
#include <ctime>
#include <fstream>
#include <sys/utsname.h>
#include <thread>

namespace nilio::tools {

namespace {

constexpr double kMebibyte = 1024.0 * 1024.0;

std::string translation(const std::optional<SegmentError>& segment) {
  return segment ? fixed(segment->translation_percent, 3) : "-";
}

std::string rotation(const std::optional<SegmentError>& segment) {
  return segment ? fixed(segment->rotation_deg_per_100m, 3) : "-";
}

/// "2.31 / 4.90 / 7.12".
std::string three(const Spread& spread) {
  return fixed(spread.median, 2) + " / " + fixed(spread.p99, 2) + " / " + fixed(spread.max, 2);
}

/// "62, 33": of the whole process, with what it had before it made the odometry and its input.
std::string memory_text(const Measurement& m) {
  if (m.peak_resident_bytes == 0) return "-";
  const auto mebibytes = [](std::uint64_t bytes) { return fixed(static_cast<double>(bytes) / kMebibyte, 0); };
  return mebibytes(m.peak_resident_bytes) + ", " + mebibytes(m.resident_before_bytes);
}

std::string processor() {
  std::ifstream info("/proc/cpuinfo");
  std::string line;
  while (std::getline(info, line)) {
    const std::size_t colon = line.find(": ");
    if (line.starts_with("model name") && colon != std::string::npos) return line.substr(colon + 2);
  }
  return "unknown processor";
}

}  // namespace

std::string label_of(const Measurement& measurement) {
  if (measurement.threads == 1) return measurement.name;
  return measurement.name + ", " + std::to_string(measurement.threads) + " threads";
}

BenchTable accuracy_table(std::span<const Measurement> measurements) {
  BenchTable table{{"registration", "t %, 10-80 m", "r deg/100 m", "t %, 100-800 m", "r deg/100 m", "APE m",
                    "RPE cm", "RPE deg", "path m", "of true"},
                   {}};
  for (const Measurement& m : measurements) {
    // The trajectory does not depend on the number of threads: one row a method.
    if (!table.rows.empty() && table.rows.back().front() == m.name) continue;
    const Accuracy& a = m.accuracy;
    const double share = a.truth_length_m > 0.0 ? 100.0 * a.estimate_length_m / a.truth_length_m : 100.0;
    table.rows.push_back({m.name, translation(a.near), rotation(a.near), translation(a.far), rotation(a.far),
                          fixed(a.ape_m, 3), fixed(100.0 * a.rpe_m, 2), fixed(a.rpe_deg, 3),
                          fixed(a.estimate_length_m, 1), fixed(share, 2) + " %"});
  }
  return table;
}

BenchTable consistency_table(std::span<const Measurement> measurements) {
  BenchTable table{{"registration", "steps", "NEES of a step", "within 95 %", "of a second", "within 95 %",
                    "of the twist", "within 95 %"},
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

BenchTable cost_table(std::span<const Measurement> measurements) {
  BenchTable table{
      {"registration", "CPU ms/scan", "CPU from packets on", "wall ms/scan", "peak memory MiB, before",
       "allocations, first " + std::to_string(kWarmUpScans) + " scans", "allocations/scan then"},
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

BenchTable stage_table(std::span<const Measurement> measurements) {
  BenchTable table{{"registration"}, {}};
  for (std::size_t s = 0; s < kStages; ++s) table.headings.push_back(stage_name(s) + std::string(" CPU ms"));
  for (std::size_t s = 0; s < kStages; ++s) table.headings.push_back(stage_name(s) + std::string(" wall ms"));
  for (const Measurement& m : measurements) {
    std::vector<std::string> row{label_of(m)};
    for (const Spread& stage : m.cpu.stages) row.push_back(three(stage));
    for (const Spread& stage : m.wall.stages) row.push_back(three(stage));
    table.rows.push_back(std::move(row));
  }
  return table;
}

BenchTable work_table(std::span<const Measurement> measurements) {
  BenchTable table{{"registration", "scans", "with IMU", "not accepted", "points", "filtered", "used",
                    "matched", "passes", "coarse it.", "fine it.", "map voxels"},
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

BenchTable hash_table(std::span<const Measurement> measurements) {
  BenchTable table{{"registration", "threads", "SHA-256 of trajectory.tum"}, {}};
  for (const Measurement& m : measurements) {
    if (!m.sha256.empty()) table.rows.push_back({m.name, std::to_string(m.threads), m.sha256});
  }
  return table;
}

std::string describe_machine() {
  utsname system{};
  uname(&system);
  std::array<char, 32> date{};
  const std::time_t now = std::time(nullptr);
  tm broken_down{};
  std::strftime(date.data(), date.size(), "%Y-%m-%d", gmtime_r(&now, &broken_down));
  return processor() + ", " + std::to_string(std::thread::hardware_concurrency()) + " cores; " +
         system.sysname + " " + system.release + "; g++ " + __VERSION__ + "; nilio " NILIO_VERSION "; " +
         date.data();
}

std::string command_line() {
  std::ifstream file("/proc/self/cmdline", std::ios::binary);
  std::string line;
  std::string word;
  while (std::getline(file, word, '\0')) {
    if (!line.empty()) line += ' ';
    const bool plain = !word.empty() && word.find_first_of(" \t\n'\"\\$&;|<>*?()`#~") == std::string::npos;
    line += plain ? word : "'" + word + "'";
  }
  return line;
}

}  // namespace nilio::tools
