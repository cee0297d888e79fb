#include "daemon/odometry/decision_log.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>
#include <optional>
#include <system_error>

#include <nlohmann/json.hpp>

namespace nilio::daemon {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;
using nlohmann::json;

constexpr const char* kFormat = "nilio-decisions-1";

/// Reads a list of up to `capacity` unsigned numbers.
template <class Number, std::size_t capacity>
bool read_list(const json& list, std::array<Number, capacity>& numbers, std::uint8_t& size) {
  if (!list.is_array() || list.size() > capacity) return false;
  for (const json& item : list) {
    if (!item.is_number_unsigned() || item.get<std::uint64_t>() > std::numeric_limits<Number>::max())
      return false;
    numbers[size++] = item.get<Number>();
  }
  return true;
}

std::optional<ScanDecision> parse_decision(const std::string& line) {
  const json value = json::parse(line, nullptr, false);
  if (!value.is_object()) return std::nullopt;
  const auto number = [&](const char* key, std::uint64_t& target) {
    const auto found = value.find(key);
    if (found == value.end() || !found->is_number_unsigned()) return false;
    target = found->get<std::uint64_t>();
    return true;
  };
  ScanDecision decision;
  if (!number("scan", decision.sequence) || !number("imu_samples", decision.imu_samples)) return std::nullopt;
  decision.superseded = value.value("superseded", json(false)) == json(true);
  decision.guarded = value.value("guarded", json(false)) == json(true);
  if (!read_list(value.value("points", json::array()), decision.budget.counts, decision.budget.count_size) ||
      !read_list(value.value("stops", json::array()), decision.budget.stops, decision.budget.stop_size) ||
      !read_list(value.value("lidar_packets", json::array()), decision.merge.packets, decision.merge.lidars))
    return std::nullopt;
  decision.merge.merged = decision.merge.lidars > 0;
  return decision;
}

}  // namespace

std::string decision_line(const DecisionHeader& header) {
  json value{{"format", kFormat},
             {"budget", core::name_of(header.budget_mode)},
             {"budget_ms", static_cast<double>(header.budget.ns) * 1e-6}};
  if (!header.recording.empty()) value["recording"] = header.recording;
  return value.dump();
}

std::string decision_line(const ScanDecision& decision) {
  json value{{"scan", decision.sequence}, {"imu_samples", decision.imu_samples}};
  if (decision.superseded) value["superseded"] = true;
  if (decision.guarded) value["guarded"] = true;
  const core::BudgetDecisions& budget = decision.budget;
  for (std::size_t i = 0; i < budget.count_size; ++i) value["points"].push_back(budget.counts[i]);
  for (std::size_t i = 0; i < budget.stop_size; ++i) value["stops"].push_back(budget.stops[i]);
  const MergeDecision& merge = decision.merge;
  for (std::size_t i = 0; merge.merged && i < merge.lidars; ++i)
    value["lidar_packets"].push_back(merge.packets[i]);
  return value.dump();
}

namespace {

/// Opens a decision log and parses its first line.
Result<json> open_decisions(const std::string& path, std::ifstream& file) {
  file.open(path);
  if (!file)
    return Error{path + ": cannot be opened - a run with --output or --record writes decisions.jsonl"};
  std::string line;
  std::getline(file, line);
  json header = json::parse(line, nullptr, false);
  if (!header.is_object() || header.value("format", json()) != json(kFormat))
    return Error{path + ":1: not a decision log (" + kFormat + ") - a run under live rules writes one"};
  return header;
}

}  // namespace

Result<RunToRepeat> find_run_to_repeat(const std::string& path, bool has_recording) {
  std::error_code ignored;
  const fs::path file = fs::is_directory(path, ignored) ? fs::path(path) / "decisions.jsonl" : fs::path(path);
  std::ifstream stream;
  const Result<json> header = open_decisions(file.string(), stream);
  if (!header) return header.error();
  RunToRepeat run{file.string(), {}, {}};
  if (has_recording) return run;
  const fs::path folder = fs::absolute(file).parent_path();
  for (const json& item : header->value("recording", json::array())) {
    if (item.is_string()) run.recording.push_back(item.get<std::string>());
  }
  if (run.recording.empty()) run.recording = {folder.string()};
  for (const std::string& item : run.recording) {
    if (!fs::exists(item, ignored))
      return Error{file.string() + ": its recording " + item +
                   " does not exist - name it with --replay, or record the next run with --record"};
  }
  if (fs::exists(folder / "config.yaml", ignored)) run.configuration = folder / "config.yaml";
  return run;
}

Result<std::vector<ScanDecision>> read_decisions(const std::string& path) {
  std::ifstream file;
  if (const Result<json> header = open_decisions(path, file); !header) return header.error();
  std::string line;
  std::vector<ScanDecision> decisions;
  for (std::size_t number = 2; std::getline(file, line); ++number) {
    const std::optional<ScanDecision> decision = parse_decision(line);
    if (!decision)
      return Error{path + ":" + std::to_string(number) + ": not a scan decision: " + line.substr(0, 80)};
    if (!decisions.empty() && decision->sequence <= decisions.back().sequence)
      return Error{path + ":" + std::to_string(number) + ": scan " + std::to_string(decision->sequence) +
                   " comes after scan " + std::to_string(decisions.back().sequence)};
    decisions.push_back(*decision);
  }
  return decisions;
}

}  // namespace nilio::daemon
