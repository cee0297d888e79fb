#include "process_memory.hpp"

#include <fstream>
#include <malloc.h>
#include <sstream>
#include <string>
#include <string_view>

namespace nilio::tools {

namespace {

/// A line "VmRSS:   1234 kB" of /proc/self/status, bytes.
std::uint64_t status_bytes(std::string_view key) {
  std::ifstream status("/proc/self/status");
  std::string line;
  while (std::getline(status, line)) {
    if (!line.starts_with(key)) continue;
    std::istringstream text(line.substr(key.size()));
    std::uint64_t kibibytes = 0;
    return text >> kibibytes ? kibibytes * 1024 : 0;
  }
  return 0;
}

}  // namespace

std::uint64_t reset_peak_resident() {
  malloc_trim(0);
  // proc(5): 5 resets the high water mark.
  std::ofstream("/proc/self/clear_refs") << '5' << std::flush;
  return status_bytes("VmRSS:");
}

std::uint64_t peak_resident() { return status_bytes("VmHWM:"); }

}  // namespace nilio::tools
