#include "tools/view/process_use.hpp"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <unistd.h>

namespace nilio::tools::view {

namespace {

namespace fs = std::filesystem;

double boot_unix_s() {
  std::ifstream file("/proc/stat");
  std::string key;
  double value = 0.0;
  while (file >> key) {
    if (key == "btime" && file >> value) return value;
    std::getline(file, key);
  }
  return 0.0;
}

/// Adds the process of a /proc/PID folder if it has this name, or if the name is empty.
bool add_process(const fs::path& folder, const std::string& name, ProcessUse& use) {
  std::ifstream file(folder / "stat");
  std::string line;
  if (!std::getline(file, line)) return false;
  // pid (name) state ...: the name may hold anything.
  const std::size_t open = line.find('(');
  const std::size_t close = line.rfind(')');
  if (open == std::string::npos || close == std::string::npos) return false;
  if (!name.empty() && line.substr(open + 1, close - open - 1) != name) return false;
  std::istringstream fields(line.substr(close + 2));
  std::string skipped;
  double user = 0.0;
  double system = 0.0;
  double start = 0.0;
  double pages = 0.0;
  // Fields 3 to 13 of proc(5), then utime and stime, 16 to 21, starttime, vsize, rss.
  for (int i = 3; i <= 13; ++i) fields >> skipped;
  fields >> user >> system;
  for (int i = 16; i <= 21; ++i) fields >> skipped;
  fields >> start >> skipped >> pages;
  if (!fields) return false;
  const auto ticks = static_cast<double>(::sysconf(_SC_CLK_TCK));
  use.cpu_s += (user + system) / ticks;
  use.resident_bytes += pages * static_cast<double>(::sysconf(_SC_PAGESIZE));
  use.start_unix_s = std::max(use.start_unix_s, boot_unix_s() + start / ticks);
  return true;
}

}  // namespace

ProcessUse own_use() {
  ProcessUse use{.name = "nilio-view"};
  add_process("/proc/self", "", use);
  return use;
}

std::optional<ProcessUse> use_of(const std::string& name) {
  ProcessUse use{.name = name};
  bool found = false;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/proc", error)) {
    const std::string file = entry.path().filename().string();
    if (!file.empty() && std::ranges::all_of(file, [](char c) { return c >= '0' && c <= '9'; }))
      found = add_process(entry.path(), name, use) || found;
  }
  if (!found) return std::nullopt;
  return use;
}

}  // namespace nilio::tools::view
