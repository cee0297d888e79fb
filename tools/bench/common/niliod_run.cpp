#include "tools/bench/common/niliod_run.hpp"

#include "nilio/core/clock.hpp"
#include "nilio/core/units.hpp"

#include "daemon/exit_status.hpp"
#include "daemon/output/sha256.hpp"
#include "tools/common/files.hpp"

#include <algorithm>
#include <array>
#include <string_view>

#include <nlohmann/json.hpp>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Duration;
using core::Error;
using core::Result;
using nlohmann::json;

constexpr Duration kPatience = Duration::from_seconds(10.0);
/// Longer than any drive; ends a niliod that hangs.
constexpr Duration kLongestReplay = Duration::from_seconds(4.0 * 3600.0);

Result<std::string> read_file(const fs::path& path) {
  std::optional<std::string> text = file_text(path);
  if (!text) return Error{path.string() + ": is missing - see niliod.log beside it"};
  return std::move(*text);
}

/// Member object; an empty one when there is none.
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

/// Reads the form of ipc::latency_json(); the unit may also be part of the member's name.
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

void read_packets(const json& report, NiliodFigures& figures) {
  const auto lidars = report.find("lidars");
  if (lidars == report.end() || !lidars->is_array()) return;
  for (const json& lidar : *lidars) {
    figures.packets += count_in(lidar, "packets") + count_in(lidar, "packets_position");
    figures.packets_lost += count_in(lidar, "packets_lost");
    figures.packets_dropped +=
        count_in(lidar, "packets_dropped_kernel") + count_in(lidar, "packets_dropped_ring");
  }
}

/// Sorts levels by work, which JSON sorts by name. Unknown ones come last.
NamedCounts in_order_of_work(const NamedCounts& counts) {
  static constexpr std::array<std::string_view, 5> kLevels{"full", "fewer_points", "ndt_only", "icp_only",
                                                           "prediction"};
  const auto place = [](const auto& entry) { return std::find(kLevels.begin(), kLevels.end(), entry.first); };
  NamedCounts ordered = counts;
  std::stable_sort(ordered.begin(), ordered.end(),
                   [&](const auto& a, const auto& b) { return place(a) < place(b); });
  return ordered;
}

void read_budget(const json& budget, NiliodFigures& figures) {
  figures.budget_mode = text_in(budget, "mode");
  figures.budget_ms = number_in(budget, "budget_ms");
  figures.predicted_by_guard = count_in(budget, "predicted_by_guard");
  figures.late_poses = count_in(budget, "late_poses");
  figures.degradation_levels = in_order_of_work(counts_in(budget, "degradation_levels"));
  figures.stops = counts_in(budget, "stops");
  figures.overshoot = summary_in(budget, "overshoot_us");
  figures.iteration = summary_in(budget, "iteration_us");
}

}  // namespace

Result<NiliodFigures> read_run_figures(const fs::path& folder) {
  const Result<std::string> text = read_file(folder / "latency.json");
  if (!text) return text.error();
  const json report = json::parse(*text, nullptr, false);
  if (!report.is_object())
    return Error{(folder / "latency.json").string() +
                 ": is not the JSON that niliod writes - use the niliod of this version"};
  NiliodFigures figures;
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
  figures.sha256 = daemon::sha256(*kitti);
  if (figures.poses == 0) return figures;
  Result<Trajectory> trajectory = read_trajectory((folder / "trajectory.tum").string());
  if (!trajectory) return trajectory.error();
  figures.trajectory = std::move(trajectory).value();
  return figures;
}

Result<ChildProcess> start_niliod(std::vector<std::string> arguments,
                                  const std::vector<std::string>& overrides, const fs::path& folder,
                                  std::vector<std::string> environment) {
  const Result<fs::path> program = find_sibling_program("niliod");
  if (!program) return program.error();
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return Error{folder.string() + ": cannot be created (" + error.message() + ")"};
  arguments.insert(arguments.end(), {"--output", folder.string(), "--force", "--set", "output.map=false"});
  for (const std::string& assignment : overrides) arguments.insert(arguments.end(), {"--set", assignment});
  return ChildProcess::start(*program, arguments, folder / "niliod.log", std::move(environment));
}

std::vector<std::string> replay_arguments(const daemon::ReplayFiles& files) {
  std::vector<std::string> arguments{"--replay"};
  arguments.insert(arguments.end(), files.captures.begin(), files.captures.end());
  arguments.insert(arguments.end(), files.can_logs.begin(), files.can_logs.end());
  if (!files.configuration.empty()) arguments.insert(arguments.end(), {"--config", files.configuration});
  return arguments;
}

Result<std::monostate> await_end(ChildProcess& program, Duration limit, StopSignals& signals) {
  const std::int64_t deadline = monotonic_ns() + limit.ns;
  while (!program.poll()) {
    if (signals.wait(kPoll)) {
      program.stop(kPatience);
      return Error{"interrupted"};
    }
    if (monotonic_ns() > deadline) {
      program.stop(kPatience);
      return Error{"niliod had not ended after " + std::to_string(limit.ns / kNanosecondsPerSecond) +
                   " s: " + program.last_line()};
    }
  }
  // A run that lost tracking has its figures.
  if (*program.poll() == kDone || *program.poll() == kBadResult) return std::monostate{};
  return Error{"niliod ended with status " + std::to_string(*program.poll()) + ": " + program.last_line()};
}

Result<NiliodFigures> run_niliod_over_file(const FileRun& run, const fs::path& folder, StopSignals& signals) {
  std::vector<std::string> arguments = replay_arguments(run.files);
  if (!run.decisions.empty()) arguments.insert(arguments.end(), {"--decisions", run.decisions});
  std::vector<std::string> overrides{"publisher.enabled=false"};
  overrides.insert(overrides.end(), run.overrides.begin(), run.overrides.end());
  Result<ChildProcess> niliod = start_niliod(std::move(arguments), overrides, folder, run.environment);
  if (!niliod) return niliod.error();
  const auto ended = await_end(*niliod, kLongestReplay, signals);
  if (!ended) return ended.error();
  return read_run_figures(folder);
}

}  // namespace nilio::tools::bench
