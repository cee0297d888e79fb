#include "tools/view/run_document.hpp"

#include "tools/common/files.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/evaluate/error_series.hpp"
#include "tools/evaluate/metrics.hpp"
#include "tools/plot/map.hpp"
#include "tools/view/point_tiles.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <random>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

namespace nilio::tools::view {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;
using nlohmann::json;

/// Points of map.ply differ by a voxel already; this only guards the number of tiles' duplicates.
constexpr double kMapVoxelMetres = 0.02;
constexpr double kStepMetres = 10.0;

double rounded(double value, double step) {
  const double result = std::round(value / step) * step;
  return std::isfinite(result) ? result : 0.0;
}

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

/// Columns of scans.csv of a run by name, every `stride`-th line, times as seconds since `start` under
/// "time_s"; and under "events" the changes of state, degradation level and time source, and losses, of all
/// lines. Null, with a line in `notes`, where the file is missing or damaged.
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
    const double time_s = (*stamp - start).seconds();
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

/// Numbers as short text: `digits` behind the point.
class Column {
 public:
  explicit Column(int digits) : scale_(std::pow(10.0, digits)) {}
  void add(double value) {
    values_.push_back(std::isfinite(value) ? json(std::round(value * scale_) / scale_) : json());
  }
  [[nodiscard]] json take() { return std::move(values_); }

 private:
  double scale_;
  json values_ = json::array();
};

json poses_json(const std::vector<core::Time>& stamps, core::Time start, const std::vector<Pose>& poses,
                std::size_t stride) {
  std::array<Column, 8> columns{Column(4), Column(3), Column(3), Column(3),
                                Column(5), Column(5), Column(5), Column(5)};
  for (std::size_t i = 0; i < poses.size(); i += stride) {
    const Eigen::Quaterniond q(poses[i].linear());
    const Eigen::Vector3d p = poses[i].translation();
    const std::array<double, 8> row{
        (stamps[i] - start).seconds(), p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), q.w()};
    for (std::size_t k = 0; k < row.size(); ++k) columns[k].add(row[k]);
  }
  constexpr std::array kNames{"t", "x", "y", "z", "qx", "qy", "qz", "qw"};
  json poses_object;
  for (std::size_t k = 0; k < columns.size(); ++k) poses_object[kNames[k]] = columns[k].take();
  const auto angles = evaluate::roll_pitch_yaw_deg(poses);
  constexpr std::array kAngles{"roll_deg", "pitch_deg", "yaw_deg"};
  for (std::size_t k = 0; k < angles.size(); ++k) {
    Column column(3);
    for (std::size_t i = 0; i < angles[k].size(); i += stride) column.add(angles[k][i]);
    poses_object[kAngles[k]] = column.take();
  }
  return poses_object;
}

json series_json(const evaluate::ErrorSeries& series, const std::vector<double>& times, std::size_t stride) {
  Column t(4);
  Column translation(5);
  Column rotation(5);
  for (std::size_t i = 0; i < series.pair.size(); i += stride) {
    t.add(times[series.pair[i]]);
    translation.add(series.translation_m[i]);
    rotation.add(series.rotation_deg[i]);
  }
  return {{"t", t.take()}, {"m", translation.take()}, {"deg", rotation.take()}};
}

/// Adds "evaluation", "errors" and, where it is in the frame of the run, "truth".
Result<std::monostate> add_truth(const std::string& folder, const Trajectory& run,
                                 const std::string& truth_path, std::size_t stride, json& document) {
  const auto truth = read_trajectory(truth_path);
  if (!truth) return truth.error();
  auto estimate = run;
  if (truth->format == TrajectoryFormat::kKitti) {
    auto camera = read_trajectory((fs::path(folder) / "trajectory.kitti").string());
    if (!camera) return camera.error();
    estimate = std::move(camera).value();
  }
  const auto pairs = evaluate::associate(*truth, estimate, {});
  if (!pairs) return pairs.error();
  const evaluate::Evaluation evaluation = evaluate::evaluate(*pairs, {});
  document["evaluation"] = json::parse(evaluate::format_json(evaluation, {evaluate::Alignment::kOrigin}));
  std::vector<double> times;
  for (const std::size_t index : pairs->estimate_index)
    times.push_back(index < run.stamps.size() ? (run.stamps[index] - run.stamps.front()).seconds() : 0.0);
  document["errors"] = {
      {"ape", series_json(evaluate::absolute_errors(*pairs, evaluate::Alignment::kOrigin), times, stride)},
      {"rpe", series_json(evaluate::relative_errors(*pairs, {}), times, stride)},
      {"rpe_10m", series_json(evaluate::relative_errors(*pairs, {1, kStepMetres}), times, stride)}};
  document["truth_path"] = fs::path(truth_path).filename().string();
  if (truth->format != TrajectoryFormat::kTum) return std::monostate{};
  // The truth in odom, by the first associated poses.
  const Pose T_odom_truth = pairs->estimate.front() * pairs->truth.front().inverse();
  std::vector<Pose> moved;
  std::vector<core::Time> stamps;
  for (std::size_t i = 0; i < pairs->truth.size(); ++i) {
    moved.push_back(T_odom_truth * pairs->truth[i]);
    stamps.push_back(run.stamps[pairs->estimate_index[i]]);
  }
  document["truth"] = poses_json(stamps, run.stamps.front(), moved, stride);
  return std::monostate{};
}

json file_json(const fs::path& path, std::vector<std::string>& notes) {
  const auto text = file_text(path);
  if (!text) {
    notes.push_back(path.filename().string() + ": missing");
    return nullptr;
  }
  json content = json::parse(*text, nullptr, false);
  if (!content.is_discarded()) return content;
  notes.push_back(path.filename().string() + ": damaged, left out");
  return nullptr;
}

std::string read_map(const fs::path& path, std::size_t max_points, json& document,
                     std::vector<std::string>& notes) {
  if (!fs::exists(path)) {
    notes.push_back("map.ply: missing");
    return {};
  }
  const auto points = plot::read_map_points(path.string());
  if (!points) {
    notes.push_back(points.error().message);
    return {};
  }
  // The same seed and the same points give the same picture.
  std::mt19937 random(1);
  const double share =
      static_cast<double>(max_points) / static_cast<double>(std::max<std::size_t>(points->size(), 1));
  PointTiles tiles({.voxel_m = kMapVoxelMetres, .max_points = 2 * max_points});
  for (std::size_t i = 0; i < points->size(); ++i) {
    if (share < 1.0 && static_cast<double>(random()) / 4294967296.0 >= share) continue;
    const Eigen::Vector3f& p = (*points)[i];
    tiles.add({p.x(), p.y(), p.z()}, static_cast<std::uint16_t>(65535 * i / points->size()));
  }
  document["map"] = {{"points", points->size()}, {"shown", tiles.points()}};
  if (share < 1.0)
    notes.push_back("map: thinned evenly from " + std::to_string(points->size()) + " to " +
                    std::to_string(tiles.points()) + " points");
  std::string bytes;
  for (const auto& [id, tile] : tiles.tiles()) {
    PointTiles::Tile shuffled = tile;
    // Any first part of a tile is an even sample of it: level of detail without further data.
    std::shuffle(shuffled.points.begin(), shuffled.points.end(), random);
    const FramePtr frame = tile_frame(shuffled, 0, PointValue::kOrder, 0.0F);
    bytes.append(reinterpret_cast<const char*>(frame->content()), frame->size());
  }
  return bytes;
}

}  // namespace

Result<RunDocument> read_run_document(const std::string& folder, const RunDocumentOptions& options) {
  const fs::path path(folder);
  std::error_code ignored;
  if (!fs::is_directory(path, ignored))
    return Error{folder + ": is not a folder - give an output folder of niliod (--output)"};
  auto trajectory = read_trajectory((path / "trajectory.tum").string());
  if (!trajectory) return trajectory.error();
  if (trajectory->stamps.empty()) return Error{folder + "/trajectory.tum: has no times"};

  RunDocument run;
  json& document = run.json;
  std::vector<std::string> notes;
  const std::size_t count = trajectory->poses.size();
  const std::size_t stride = (count + options.max_poses - 1) / options.max_poses;
  fs::path absolute = fs::absolute(path, ignored).lexically_normal();
  if (!absolute.has_filename()) absolute = absolute.parent_path();
  document["name"] = (absolute.filename() == "run" ? absolute.parent_path() : absolute).filename().string();
  document["stride"] = stride;
  if (stride > 1)
    notes.push_back("trajectory: every " + std::to_string(stride) + "th pose of " + std::to_string(count));
  document["start_unix_s"] = rounded(trajectory->stamps.front().seconds(), 1e-3);
  document["pose_count"] = count;
  // The map has the poses after loop closure.
  const auto optimised = read_trajectory((path / "trajectory_optimised.tum").string());
  const bool is_optimised = optimised && optimised->stamps == trajectory->stamps;
  if (is_optimised) notes.emplace_back("path: trajectory_optimised.tum; errors: trajectory.tum");
  document["poses"] = poses_json(trajectory->stamps, trajectory->stamps.front(),
                                 is_optimised ? optimised->poses : trajectory->poses, stride);
  document["path_length_m"] = path_length(trajectory->poses);
  document["scans"] = read_scan_table(path / "scans.csv", trajectory->stamps.front(), stride, notes);
  document["latency"] = file_json(path / "latency.json", notes);
  document["result"] = file_json(path / "result.json", notes);
  const auto config = file_text(path / "config.yaml");
  document["config"] = config ? json(*config) : json();
  if (!options.truth_path.empty()) {
    if (auto added = add_truth(folder, *trajectory, options.truth_path, stride, document); !added)
      return added.error();
  }
  run.map = read_map(path / "map.ply", options.max_map_points, document, notes);
  document["notes"] = notes;
  return run;
}

}  // namespace nilio::tools::view
