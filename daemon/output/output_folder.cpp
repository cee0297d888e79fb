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

}  // namespace

core::Result<std::string> choose_output_folder(const std::string& folder, EarlierRun earlier) {
  if (folder.empty() || !holds_run(folder)) return folder;
  if (earlier == EarlierRun::kRefuse)
    return core::Error{folder +
                       ": holds the files of an earlier run - choose another --output, or add --force"};
  if (earlier == EarlierRun::kKeep) {
    // A path that ends in '/' has an empty last component.
    fs::path base(folder);
    if (!base.has_filename()) base = base.parent_path();
    std::string next;
    for (int number = 2; next.empty() || holds_run(next); ++number)
      next = base.string() + "-" + std::to_string(number);
    return next;
  }
  for (const char* name : kFiles) {
    std::error_code error;
    fs::remove_all(fs::path(folder) / name, error);
    if (error)
      return core::Error{(fs::path(folder) / name).string() + ": cannot be removed (" + error.message() +
                         ") - check its permissions"};
  }
  return folder;
}

}  // namespace nilio::daemon
