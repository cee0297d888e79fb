#include "tools/view/scan_table.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <fstream>
#include <map>
#include <optional>
#include <string_view>

#include <nlohmann/json.hpp>

namespace nilio::tools::view {

namespace {

using nlohmann::json;

constexpr std::size_t kMaxEvents = 500;

std::vector<std::string_view> cells_of(std::string_view line) {
  std::vector<std::string_view> cells;
  for (std::size_t begin = 0; begin <= line.size();) {
    const std::size_t end = std::min(line.find(',', begin), line.size());
    cells.push_back(line.substr(begin, end - begin));
    begin = end + 1;
  }
  return cells;
}

/// Nanoseconds of "seconds.nanoseconds"; a double would lose some.
std::optional<std::int64_t> parse_stamp(std::string_view cell) {
  std::int64_t seconds = 0;
  std::int64_t ns = 0;
  const auto whole = std::from_chars(cell.data(), cell.data() + cell.size(), seconds);
  if (whole.ec != std::errc() || whole.ptr == cell.data() + cell.size() || *whole.ptr != '.')
    return std::nullopt;
  const auto fraction = std::from_chars(whole.ptr + 1, cell.data() + cell.size(), ns);
  if (fraction.ec != std::errc() || fraction.ptr != cell.data() + cell.size()) return std::nullopt;
  return seconds * 1'000'000'000 + ns;
}

json value_of(std::string_view cell) {
  if (cell.empty()) return nullptr;
  double number = 0.0;
  const auto parsed = std::from_chars(cell.data(), cell.data() + cell.size(), number);
  if (parsed.ec == std::errc() && parsed.ptr == cell.data() + cell.size()) return number;
  return std::string(cell);
}

/// Changes of a column from line to line.
class Changes {
 public:
  Changes(std::string column, std::string title) : column_(std::move(column)), title_(std::move(title)) {}

  void add(const std::map<std::string, std::string>& row, double time_s, json& events) {
    const auto cell = row.find(column_);
    if (cell == row.end()) return;
    if (!last_.empty() && last_ != cell->second && events.size() < kMaxEvents) {
      const bool is_bad = cell->second == "lost";
      const bool is_good = cell->second == "tracking" || cell->second == "full" || cell->second == "0";
      events.push_back({{"time_s", time_s},
                        {"level", is_bad    ? "error"
                                  : is_good ? "info"
                                            : "warning"},
                        {"text", "scan " + row.at("scan") + ": " + title_ + last_ + " → " + cell->second}});
    }
    last_ = cell->second;
  }

 private:
  std::string column_;
  std::string title_;
  std::string last_;
};

}  // namespace

json read_scan_table(const std::filesystem::path& path, core::Time start, std::size_t stride,
                     std::vector<std::string>& notes) {
  std::ifstream file(path);
  std::string line;
  if (!file || !std::getline(file, line)) {
    notes.push_back(
        "scans.csv: missing; the run is of an earlier version, and has no series of states and latencies");
    return nullptr;
  }
  std::vector<std::string> names;
  for (const std::string_view name : cells_of(line)) names.emplace_back(name);
  json table = json::object();
  for (const std::string& name : names) table[name == "stamp_s" ? "time_s" : name] = json::array();
  json events = json::array();
  std::array<Changes, 3> changes{Changes("state", ""), Changes("degradation_level", "degradation level "),
                                 Changes("time_source", "time source ")};
  for (std::size_t number = 0; std::getline(file, line); ++number) {
    const std::vector<std::string_view> cells = cells_of(line);
    const auto stamp =
        cells.size() == names.size() && cells.size() > 1 ? parse_stamp(cells[1]) : std::nullopt;
    if (!stamp) {
      // The last line of a run that was killed may be incomplete.
      notes.push_back("scans.csv: line " + std::to_string(number + 2) + " is damaged, and the rest left out");
      break;
    }
    const double time_s = (core::Time{*stamp} - start).seconds();
    std::map<std::string, std::string> row;
    for (std::size_t i = 0; i < names.size(); ++i) row[names[i]] = cells[i];
    for (Changes& change : changes) change.add(row, time_s, events);
    if (row["lost_packets"] != "0" && !row["lost_packets"].empty() && events.size() < kMaxEvents)
      events.push_back({{"time_s", time_s},
                        {"level", "warning"},
                        {"text", "scan " + row["scan"] + ": " + row["lost_packets"] + " packets lost"}});
    if (number % stride != 0) continue;
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (i == 1) {
        table["time_s"].push_back(time_s);
      } else {
        table[names[i]].push_back(value_of(cells[i]));
      }
    }
  }
  table["events"] = events;
  return table;
}

}  // namespace nilio::tools::view
