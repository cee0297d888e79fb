#include "tools/bench/common/process_memory.hpp"

#include <fstream>
#include <malloc.h>
#include <sstream>
#include <string>
#include <string_view>

namespace nilio::tools {

namespace {

/// Of a line "VmRSS:   1234 kB", bytes; nothing when it does not begin with `key`.
std::optional<std::uint64_t> line_bytes(const std::string& line, std::string_view key) {
  if (!line.starts_with(key)) return std::nullopt;
  std::istringstream text(line.substr(key.size()));
  std::uint64_t kibibytes = 0;
  if (!(text >> kibibytes)) return std::nullopt;
  return kibibytes * 1024;
}

/// The first such line of a file; 0 when there is none.
std::uint64_t file_bytes(const char* path, std::string_view key) {
  std::ifstream file(path);
  std::string line;
  while (std::getline(file, line)) {
    if (const auto bytes = line_bytes(line, key)) return *bytes;
  }
  return 0;
}

}  // namespace

std::uint64_t reset_peak_resident() {
  malloc_trim(0);
  // proc(5): 5 resets the high water mark.
  std::ofstream("/proc/self/clear_refs") << '5' << std::flush;
  return file_bytes("/proc/self/status", "VmRSS:");
}

std::uint64_t peak_resident() { return file_bytes("/proc/self/status", "VmHWM:"); }

std::optional<ResidentMemory> resident_memory(pid_t process) {
  std::ifstream file("/proc/" + std::to_string(process) + "/smaps_rollup");
  ResidentMemory memory;
  std::string line;
  while (std::getline(file, line)) {
    if (const auto total = line_bytes(line, "Rss:")) memory.total = *total;
    if (const auto anonymous = line_bytes(line, "Anonymous:")) memory.anonymous = *anonymous;
  }
  if (memory.total == 0) return std::nullopt;
  return memory;
}

std::uint64_t available_memory() { return file_bytes("/proc/meminfo", "MemAvailable:"); }

}  // namespace nilio::tools
