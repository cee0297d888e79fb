#include "daemon/realtime/memory_plan.hpp"

#include "ipc/kernel_requests.hpp"

#include <fstream>
#include <malloc.h>
#include <string>

namespace nilio::daemon {

namespace {

constexpr std::uint64_t kBytesPerKib = 1024;

std::string mib_text(std::uint64_t bytes) { return std::to_string(bytes >> 20U) + " MiB"; }

}  // namespace

void prepare_heap(const ThreadPlan& plan) {
  if (!plan.lock_memory) return;
  mallopt(M_ARENA_MAX, 1);
  mallopt(M_TRIM_THRESHOLD, -1);
  mallopt(M_MMAP_MAX, 0);
}

MemoryUse memory_use() {
  MemoryUse use;
  std::ifstream status("/proc/self/status");
  std::string name;
  std::uint64_t kib = 0;
  for (std::string line; std::getline(status, line);) {
    const auto colon = line.find(':');
    if (colon == std::string::npos || line.find("kB") == std::string::npos) continue;
    name = line.substr(0, colon);
    kib = std::strtoull(line.c_str() + colon + 1, nullptr, 10);
    if (name == "VmRSS") use.resident_bytes = kib * kBytesPerKib;
    if (name == "VmHWM") use.peak_resident_bytes = kib * kBytesPerKib;
    if (name == "VmLck") use.locked_bytes = kib * kBytesPerKib;
  }
  return use;
}

PlanOutcome lock_process_memory(const ThreadPlan& plan) {
  if (!plan.lock_memory) return {true, "memory: not locked"};
  if (const std::string refused = ipc::request_memory_lock(); !refused.empty())
    return {false, "memory: " + refused};
  const MemoryUse use = memory_use();
  return {true, "memory: locked, so far " + mib_text(use.locked_bytes) + " of which " +
                    mib_text(use.resident_bytes) + " are in use"};
}

}  // namespace nilio::daemon
