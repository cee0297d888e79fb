#include "tools/evaluate/run_table.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <set>
#include <utility>

#include <nlohmann/json.hpp>

namespace nilio::tools::evaluate {

namespace {

namespace fs = std::filesystem;
using nlohmann::json;

double percent_of(const json& states, const char* state, std::uint64_t poses) {
  return poses == 0 ? 0.0 : 100.0 * states.at(state).get<double>() / static_cast<double>(poses);
}

/// Throws json::exception for a missing or wrong value.
RunNumbers numbers_of(const json& result) {
  RunNumbers n;
  n.exit_status = result.at("exit_status").get<int>();
  n.poses = result.at("poses").get<std::uint64_t>();
  const json& states = result.at("states");
  n.tracking_percent = percent_of(states, "tracking", n.poses);
  n.degraded_percent = percent_of(states, "degraded", n.poses);
  n.lost_percent = percent_of(states, "lost", n.poses);
  for (const auto& [reason, count] : result.at("resets").items())
    if (reason != "initialisation") n.resets += count.get<std::uint64_t>();
  n.path_length_m = result.at("path_length_m").get<double>();
  n.duration_s = result.at("duration_s").get<double>();
  n.cpu_s = result.at("cpu_s").get<double>();
  n.time_source = result.at("time_source").get<std::string>();
  n.version = result.at("versions").at("nilio").get<std::string>();
  n.configuration_hash = result.at("configuration_hash").get<std::string>();
  n.trajectory_sha256 = result.at("trajectory_sha256").get<std::string>();
  return n;
}

std::string number(const char* format, double value) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), format, value);
  return text.data();
}

std::string find_problem(const json& result, const RunNumbers& n, const RunLimits& limits) {
  if (n.exit_status != 0) return result.value("problem", "exit status " + std::to_string(n.exit_status));
  if (limits.max_lost_percent && n.lost_percent > *limits.max_lost_percent)
    return "lost at " + number("%.2f", n.lost_percent) + " % of the poses exceeds --max-lost";
  if (limits.max_resets && n.resets > *limits.max_resets)
    return std::to_string(n.resets) + " resets exceed --max-resets";
  return "";
}

using Cells = std::vector<std::string>;

/// Pads each column to its longest cell; the last one stays as it is.
std::string aligned(const std::vector<Cells>& lines) {
  std::vector<std::size_t> widths(lines.front().size());
  for (const Cells& line : lines)
    for (std::size_t i = 0; i < line.size(); ++i) widths[i] = std::max(widths[i], line[i].size());
  std::string text;
  for (const Cells& line : lines) {
    std::string row;
    for (std::size_t i = 0; i < line.size(); ++i) {
      const std::string padding(widths[i] - line[i].size(), ' ');
      const bool is_text = i == 0 || i + 1 == line.size();
      row += (i == 0 ? "" : "  ") + (is_text ? line[i] + padding : padding + line[i]);
    }
    text += row.substr(0, row.find_last_not_of(' ') + 1) + "\n";
  }
  return text;
}

std::string summary(const std::vector<RunRow>& rows) {
  double metres = 0.0;
  double driven_s = 0.0;
  double cpu_s = 0.0;
  std::size_t problems = 0;
  std::size_t missing = 0;
  std::set<std::string> configurations;
  std::set<std::string> versions;
  for (const RunRow& row : rows) {
    if (!row.problem.empty()) ++problems;
    if (!row.numbers) {
      ++missing;
      continue;
    }
    metres += row.numbers->path_length_m;
    driven_s += row.numbers->duration_s;
    cpu_s += row.numbers->cpu_s;
    configurations.insert(row.numbers->configuration_hash);
    versions.insert(row.numbers->version);
  }
  return std::to_string(rows.size()) + " runs, " + std::to_string(problems) + " with a problem, of which " +
         std::to_string(missing) + " without a result; " + number("%.2f", 1e-3 * metres) + " km, " +
         number("%.2f", driven_s / 3600.0) + " h driven, " + number("%.2f", cpu_s / 3600.0) +
         " h of CPU; configurations: " + std::to_string(configurations.size()) +
         ", versions: " + std::to_string(versions.size()) + "\n";
}

std::string quoted(const std::string& cell) {
  if (cell.find_first_of(",\"\n\r") == std::string::npos) return cell;
  std::string text = "\"";
  for (const char c : cell) text += c == '"' ? "\"\"" : std::string(1, c);
  return text + "\"";
}

json row_json(const RunRow& row) {
  json value{{"run", row.run}, {"problem", row.problem}};
  if (!row.numbers) return value;
  const RunNumbers& n = *row.numbers;
  value.update({{"exit_status", n.exit_status},
                {"poses", n.poses},
                {"tracking_percent", n.tracking_percent},
                {"degraded_percent", n.degraded_percent},
                {"lost_percent", n.lost_percent},
                {"resets", n.resets},
                {"path_length_m", n.path_length_m},
                {"duration_s", n.duration_s},
                {"cpu_s", n.cpu_s},
                {"time_source", n.time_source},
                {"version", n.version},
                {"configuration_hash", n.configuration_hash},
                {"trajectory_sha256", n.trajectory_sha256}});
  return value;
}

}  // namespace

RunRow read_run(const std::string& path, const RunLimits& limits) {
  RunRow row{path, std::nullopt, ""};
  std::error_code error;
  const fs::path file = fs::is_directory(path, error) ? fs::path(path) / "result.json" : fs::path(path);
  std::ifstream stream(file);
  if (!stream) {
    row.problem = "no result.json: the run failed, was stopped or still runs";
    return row;
  }
  try {
    const json result = json::parse(stream);
    row.numbers = numbers_of(result);
    row.problem = find_problem(result, *row.numbers, limits);
  } catch (const json::exception& exception) {
    row.numbers.reset();
    row.problem = std::string("damaged result.json: ") + exception.what();
  }
  return row;
}

std::string run_table_text(const std::vector<RunRow>& rows) {
  std::vector<Cells> lines{{"run", "status", "poses", "tracking %", "degraded %", "lost %", "resets",
                            "path m", "CPU s", "time source", "trajectory", "problem"}};
  for (const RunRow& row : rows) {
    if (!row.numbers) {
      lines.push_back({row.run, "-", "-", "-", "-", "-", "-", "-", "-", "-", "-", row.problem});
      continue;
    }
    const RunNumbers& n = *row.numbers;
    lines.push_back({row.run, std::to_string(n.exit_status), std::to_string(n.poses),
                     number("%.2f", n.tracking_percent), number("%.2f", n.degraded_percent),
                     number("%.2f", n.lost_percent), std::to_string(n.resets),
                     number("%.2f", n.path_length_m), number("%.1f", n.cpu_s), n.time_source,
                     n.trajectory_sha256.substr(0, 12), row.problem});
  }
  return aligned(lines) + "\n" + summary(rows);
}

std::string run_table_csv(const std::vector<RunRow>& rows) {
  constexpr std::array kColumns{"run",
                                "problem",
                                "exit_status",
                                "poses",
                                "tracking_percent",
                                "degraded_percent",
                                "lost_percent",
                                "resets",
                                "path_length_m",
                                "duration_s",
                                "cpu_s",
                                "time_source",
                                "version",
                                "configuration_hash",
                                "trajectory_sha256"};
  std::string text;
  for (const char* column : kColumns) text += (text.empty() ? "" : ",") + std::string(column);
  text += "\n";
  for (const RunRow& row : rows) {
    const json values = row_json(row);
    std::string line;
    for (const char* column : kColumns) {
      const auto value = values.find(column);
      const std::string cell = value == values.end() ? ""
                               : value->is_string()  ? value->get<std::string>()
                                                     : value->dump();
      line += (column == kColumns.front() ? "" : ",") + quoted(cell);
    }
    text += line + "\n";
  }
  return text;
}

std::string run_table_json(const std::vector<RunRow>& rows) {
  json runs = json::array();
  for (const RunRow& row : rows) runs.push_back(row_json(row));
  const auto problems =
      std::count_if(rows.begin(), rows.end(), [](const RunRow& r) { return !r.problem.empty(); });
  return json{{"runs", runs}, {"problems", problems}}.dump(2) + "\n";
}

}  // namespace nilio::tools::evaluate
