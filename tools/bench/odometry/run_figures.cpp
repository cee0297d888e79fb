#include "tools/bench/odometry/run_figures.hpp"

#include "tools/bench/odometry/measure.hpp"
#include "tools/common/file_text.hpp"
#include "tools/common/sha256.hpp"

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

#include <nlohmann/json.hpp>

namespace nilio::tools {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;
using nlohmann::json;

Result<std::string> read_file(const fs::path& path) {
  std::optional<std::string> text = file_text(path);
  if (!text) return Error{path.string() + ": is not there: did niliod end before it could write it?"};
  return std::move(*text);
}

/// An object in another; an empty one when there is none.
const json& object_in(const json& parent, const char* key) {
  static const json empty = json::object();
  const auto found = parent.find(key);
  return found != parent.end() && found->is_object() ? *found : empty;
}

std::uint64_t count_in(const json& parent, const char* key) {
  const auto found = parent.find(key);
  return found != parent.end() && found->is_number_unsigned() ? found->get<std::uint64_t>() : 0;
}

std::optional<double> number_in(const json& parent, const std::string& key) {
  const auto found = parent.find(key);
  if (found == parent.end() || !found->is_number()) return std::nullopt;
  return found->get<double>();
}

std::string text_in(const json& parent, const char* key) {
  const auto found = parent.find(key);
  return found != parent.end() && found->is_string() ? found->get<std::string>() : std::string();
}

NamedCounts counts_in(const json& parent, const char* key) {
  NamedCounts counts;
  for (const auto& [name, value] : object_in(parent, key).items()) {
    if (value.is_number_unsigned()) counts.emplace_back(name, value.get<std::uint64_t>());
  }
  return counts;
}

/// As ipc::latency_json() writes it; the unit may also be in the name of the whole.
std::optional<ipc::LatencySummary> summary_in(const json& parent, const char* key) {
  const json& object = object_in(parent, key);
  if (object.empty()) return std::nullopt;
  const auto value = [&](const std::string& name) {
    const auto with_unit = number_in(object, name + "_us");
    return with_unit ? *with_unit : number_in(object, name).value_or(0.0);
  };
  ipc::LatencySummary summary;
  summary.name = key;
  summary.count = count_in(object, "count");
  summary.p50_us = value("p50");
  summary.p90_us = value("p90");
  summary.p99_us = value("p99");
  summary.p99_9_us = value("p99_9");
  summary.max_us = value("max");
  return summary;
}

void read_packets(const json& report, RunFigures& figures) {
  const auto lidars = report.find("lidars");
  if (lidars == report.end() || !lidars->is_array()) return;
  for (const json& lidar : *lidars) {
    figures.packets += count_in(lidar, "packets") + count_in(lidar, "packets_position");
    figures.packets_lost += count_in(lidar, "packets_lost");
    figures.packets_dropped +=
        count_in(lidar, "packets_dropped_kernel") + count_in(lidar, "packets_dropped_ring");
  }
}

/// From the most work to the least; JSON has them by name. Others come last.
NamedCounts in_order_of_work(const NamedCounts& counts) {
  static constexpr std::array<std::string_view, 5> kRungs{"full", "fewer_points", "ndt_only", "icp_only",
                                                          "prediction"};
  const auto place = [](const auto& entry) { return std::find(kRungs.begin(), kRungs.end(), entry.first); };
  NamedCounts ordered = counts;
  std::stable_sort(ordered.begin(), ordered.end(),
                   [&](const auto& a, const auto& b) { return place(a) < place(b); });
  return ordered;
}

void read_budget(const json& budget, RunFigures& figures) {
  figures.budget_mode = text_in(budget, "mode");
  figures.budget_ms = number_in(budget, "budget_ms");
  figures.predicted_by_guard = count_in(budget, "predicted_by_guard");
  figures.late_poses = count_in(budget, "late_poses");
  figures.rungs = in_order_of_work(counts_in(budget, "rungs"));
  figures.stops = counts_in(budget, "stops");
  figures.overshoot = summary_in(budget, "overshoot_us");
  figures.iteration = summary_in(budget, "iteration_us");
}

}  // namespace

Result<RunFigures> read_run_figures(const fs::path& folder) {
  const Result<std::string> text = read_file(folder / "latency.json");
  if (!text) return text.error();
  const json report = json::parse(*text, nullptr, false);
  if (!report.is_object())
    return Error{(folder / "latency.json").string() + ": is not the JSON that niliod writes"};
  RunFigures figures;
  const json& counters = object_in(report, "counters");
  figures.scans = count_in(counters, "scans");
  figures.poses = count_in(counters, "poses");
  figures.superseded = count_in(counters, "scans_superseded");
  figures.scans_with_imu = count_in(counters, "scans_with_imu");
  figures.clock_source = text_in(report, "clock_source");
  read_packets(report, figures);
  read_budget(object_in(report, "budget"), figures);
  figures.end_to_end = summary_in(object_in(report, "stages"), "end_to_end");
  const Result<std::string> kitti = read_file(folder / "trajectory.kitti");
  if (!kitti) return kitti.error();
  figures.sha256 = sha256(*kitti);
  if (figures.poses == 0) return figures;
  Result<Trajectory> trajectory = read_trajectory((folder / "trajectory.tum").string());
  if (!trajectory) return trajectory.error();
  figures.trajectory = std::move(trajectory).value();
  return figures;
}

std::optional<double> translation_error_percent(const std::optional<Trajectory>& truth, Trajectory estimate,
                                                core::Duration shift) {
  if (!truth || estimate.poses.size() < 2) return std::nullopt;
  for (core::Time& stamp : estimate.stamps) stamp = stamp + shift;
  const Result<Accuracy> accuracy = judge_trajectory(*truth, estimate);
  if (!accuracy || !accuracy->near) return std::nullopt;
  return accuracy->near->translation_percent;
}

}  // namespace nilio::tools
