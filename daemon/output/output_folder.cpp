#include "daemon/output/output_folder.hpp"

#include <algorithm>
#include <array>
#include <filesystem>
#include <system_error>

namespace nilio::daemon {

namespace {

namespace fs = std::filesystem;

/// Files of RunOutput.
constexpr std::array kFiles{"trajectory.tum",
                            "trajectory_optimised.tum",
                            "trajectory_mid.tum",
                            "trajectory_map.tum",
                            "localisation.txt",
                            "trajectory.kitti",
                            "scans.csv",
                            "latency.json",
                            "latency",
                            "decisions.jsonl",
                            "map.ply",
                            "run.mcap",
                            "map",
                            "config.yaml",
                            "result.json"};

bool holds_run(const fs::path& folder) {
  return std::any_of(kFiles.begin(), kFiles.end(), [&](const char* name) {
    std::error_code ignored;
    return fs::exists(folder / name, ignored);
  });
}

/// FOLDER, FOLDER-2, FOLDER-3, ...
std::string numbered(const std::string& folder, int number) {
  // A path that ends in '/' has an empty last component.
  fs::path base(folder);
  if (!base.has_filename()) base = base.parent_path();
  return number == 1 ? base.string() : base.string() + "-" + std::to_string(number);
}

/// Number of the first one without a run.
int next_number(const std::string& folder) {
  int number = 1;
  while (holds_run(numbered(folder, number))) ++number;
  return number;
}

}  // namespace

core::Result<std::string> choose_output_folder(const std::string& folder, EarlierRun earlier) {
  if (folder.empty() || !holds_run(folder)) return folder;
  if (earlier == EarlierRun::kRefuse)
    return core::Error{folder +
                       ": holds the files of an earlier run - choose another --output, or add --force"};
  if (earlier == EarlierRun::kKeep) return numbered(folder, next_number(folder));
  for (const char* name : kFiles) {
    std::error_code error;
    fs::remove_all(fs::path(folder) / name, error);
    if (error)
      return core::Error{(fs::path(folder) / name).string() + ": cannot be removed (" + error.message() +
                         ") - check its permissions"};
  }
  return folder;
}

std::string find_killed_run(const std::string& folder) {
  const int runs = folder.empty() ? 0 : next_number(folder) - 1;
  if (runs == 0) return {};
  const std::string last = numbered(folder, runs);
  std::error_code ignored;
  const bool is_killed = fs::exists(fs::path(last) / "map" / "map.log", ignored) &&
                         !fs::exists(fs::path(last) / "latency.json", ignored);
  return is_killed ? last : std::string();
}

}  // namespace nilio::daemon
