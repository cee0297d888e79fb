#include "daemon/input/replay_files.hpp"

#include "nilio/drivers/bag/bag.hpp"
#include "nilio/drivers/capture/file_kind.hpp"

#include "daemon/input/kitti_sequence.hpp"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <string_view>
#include <variant>

namespace nilio::daemon {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;
using drivers::FileKind;

/// Stores `path` in the slot of its kind; an error if the slot is taken.
Result<std::monostate> put(std::string& slot, const std::string& path, const std::string& kind) {
  if (!slot.empty())
    return Error{path + ": a second " + kind + " beside " + slot + ": name the one to replay"};
  slot = path;
  return std::monostate{};
}

/// Number of a file written by `nilio record`, such as 12 of lidar_0012.pcap.
std::optional<std::uint64_t> part_number(const fs::path& path) {
  const std::string name = path.stem().string();
  const std::string extension = path.extension().string();
  const std::string_view prefix = extension == ".pcap" ? "lidar_" : extension == ".log" ? "can_" : "";
  if (prefix.empty() || !name.starts_with(prefix)) return std::nullopt;
  const char* const end = name.data() + name.size();
  std::uint64_t number = 0;
  const auto parsed = std::from_chars(name.data() + prefix.size(), end, number);
  if (parsed.ec != std::errc{} || parsed.ptr != end) return std::nullopt;
  return number;
}

/// Adds `path` to the parts of one recording; an error if it belongs to another recording.
Result<std::monostate> put_part(std::vector<std::string>& parts, const fs::path& path,
                                const std::string& kind) {
  if (!parts.empty()) {
    const fs::path first = parts.front();
    const auto number = part_number(path);
    const bool together = number && path.parent_path() == first.parent_path() &&
                          std::all_of(parts.begin(), parts.end(), [&](const std::string& part) {
                            const auto other = part_number(part);
                            return other && other != number;
                          });
    if (!together)
      return Error{path.string() + ": a second " + kind + " beside " + first.string() +
                   ": name the one to replay"};
  }
  parts.push_back(path.string());
  std::stable_sort(parts.begin(), parts.end(), [](const std::string& a, const std::string& b) {
    return part_number(a) < part_number(b);
  });
  return std::monostate{};
}

/// Number at the end of the name of a part, such as 12 of drive_12.bag.
bool has_part_number(const fs::path& path) {
  const std::string stem = path.stem().string();
  const std::size_t digits = stem.size() - (stem.find_last_not_of("0123456789") + 1);
  return digits > 0 && digits < stem.size() && stem[stem.size() - digits - 1] == '_';
}

Result<std::monostate> put_bag(const fs::path& path, ReplayFiles& files, bool named_by_user) {
  if (!files.bags.empty() && !named_by_user &&
      !(has_part_number(files.bags.front()) && has_part_number(path)))
    return Error{path.string() + ": a second ROS bag beside " + files.bags.front() +
                 ": name the one to replay"};
  files.bags.push_back(path.string());
  return std::monostate{};
}

Result<std::monostate> sort_file(const fs::path& path, ReplayFiles& files, bool named_by_user) {
  // run.mcap is an output of niliod, no input of the next run.
  if (path.filename() == "run.mcap" && !named_by_user) return std::monostate{};
  if (path.filename() == "nilio.yaml") return put(files.configuration, path.string(), "configuration");
  const FileKind kind = drivers::file_kind(path.string());
  if (kind == FileKind::kBag) return put_bag(path, files, named_by_user);
  if (kind == FileKind::kCapture) return put_part(files.captures, path, "capture");
  // Text logs of other forms than candump -L are taken by their name; other programs write *.log files, too.
  const std::string extension = path.extension().string();
  const bool is_named_log = (named_by_user && (extension == ".log" || extension == ".asc")) ||
                            (extension == ".log" && part_number(path));
  if (kind == FileKind::kCanLog || is_named_log) return put_part(files.can_logs, path, "CAN log");
  if (named_by_user) return Error{path.string() + ": " + drivers::why_no_recording(path.string())};
  if (extension == drivers::kPartialSuffix || kind == FileKind::kCompressed)
    files.unreadable.push_back(path.string());
  return std::monostate{};
}

Result<std::monostate> sort_path(const std::string& path, ReplayFiles& files) {
  std::error_code error;
  if (!fs::exists(path, error)) return Error{path + ": does not exist"};
  if (!fs::is_directory(path, error)) return sort_file(path, files, true);
  if (is_kitti_sequence(path)) return put(files.kitti_sequence, path, "KITTI sequence");
  if (fs::exists(fs::path(path) / "metadata.yaml", error)) {
    auto bags = drivers::bag_files(path);
    if (!bags) return bags.error();
    files.bags.insert(files.bags.end(), bags->begin(), bags->end());
    const fs::path configuration = fs::path(path) / "nilio.yaml";
    return fs::exists(configuration, error) ? sort_file(configuration, files, true) : std::monostate{};
  }
  std::set<fs::path> entries;
  for (fs::directory_iterator entry(path, error), end; !error && entry != end; entry.increment(error))
    entries.insert(entry->path());
  if (error) return Error{path + ": cannot be read (" + error.message() + "); check its permissions"};
  for (const fs::path& entry : entries) {
    Result<std::monostate> sorted = sort_file(entry, files, false);
    if (!sorted) return sorted;
  }
  return std::monostate{};
}

/// First point cloud file in a folder and the folders in it, but the map of a run.
std::optional<fs::path> find_point_file(const fs::path& folder) {
  constexpr int kDepth = 2;
  constexpr int kMaxEntries = 10'000;
  std::error_code error;
  int entries = 0;
  for (fs::recursive_directory_iterator entry(folder, error), end;
       !error && entry != end && ++entries < kMaxEntries; entry.increment(error)) {
    if (entry.depth() >= kDepth) entry.disable_recursion_pending();
    const std::string extension = entry->path().extension().string();
    const bool is_cloud = extension == ".bin" || extension == ".pcd" || extension == ".ply";
    if (is_cloud && entry->path().filename() != "map.ply") return entry->path();
  }
  return std::nullopt;
}

/// Contents of a folder without a recording, and the way to make it one.
std::string why_nothing(const fs::path& folder) {
  std::error_code error;
  if (fs::is_directory(folder / "velodyne_points", error))
    return "is a drive of KITTI's raw data - make a recording of it with 'nilio convert kitti-raw " +
           folder.string() + " OUTPUT'";
  if (const auto file = find_point_file(folder))
    return "holds point clouds (" + file->lexically_relative(folder).string() +
           ") that state no times - write them into a ROS bag as sensor_msgs/PointCloud2 with a field of "
           "times, or, if "
           "they are motion-compensated, into a KITTI sequence (velodyne/*.bin, times.txt, calib.txt)";
  return "nothing to replay: expected a capture (.pcap, .pcapng), a ROS bag (.bag, .db3, .mcap) or a KITTI "
         "sequence "
         "(velodyne/*.bin)";
}

}  // namespace

Result<ReplayFiles> sort_replay_files(const std::vector<std::string>& paths) {
  ReplayFiles files;
  for (const std::string& path : paths) {
    Result<std::monostate> sorted = sort_path(path, files);
    if (!sorted) return sorted.error();
  }
  if (!files.captures.empty() && !files.kitti_sequence.empty()) {
    return Error{files.captures.front() + ": beside the KITTI sequence " + files.kitti_sequence +
                 ": replay one of them"};
  }
  if (!files.bags.empty() && !(files.captures.empty() && files.kitti_sequence.empty())) {
    const std::string& other = files.captures.empty() ? files.kitti_sequence : files.captures.front();
    return Error{files.bags.front() + ": beside " + other + ": replay one of them"};
  }
  return files;
}

Result<ReplayFiles> find_replay_files(const std::vector<std::string>& paths) {
  Result<ReplayFiles> files = sort_replay_files(paths);
  if (files && files->captures.empty() && files->bags.empty() && files->kitti_sequence.empty()) {
    if (!files->unreadable.empty())
      return Error{files->unreadable.front() + ": " + drivers::why_no_recording(files->unreadable.front())};
    return Error{paths.front() + ": " + why_nothing(paths.front())};
  }
  return files;
}

void warn_of_missing_parts(const std::vector<std::string>& parts, std::vector<std::string>& warnings) {
  for (std::size_t i = 1; i < parts.size(); ++i) {
    const std::uint64_t before = *part_number(parts[i - 1]);
    const std::uint64_t next = *part_number(parts[i]);
    if (next > before + 1)
      warnings.push_back(parts[i - 1] + ": " + std::to_string(next - before - 1) +
                         " parts of the recording are missing after it");
  }
}

}  // namespace nilio::daemon
