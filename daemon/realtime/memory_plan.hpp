#pragma once

#include "daemon/realtime/thread_plan.hpp"

#include <cstdint>

namespace nilio::daemon {

/// Configures malloc so that touched memory stays mapped: no trimming, no mmap per allocation, one arena for
/// all threads. Call before threads start; no effect if the plan does not lock memory.
void prepare_heap(const ThreadPlan& plan);

/// Locks all present and future memory of the process; the outcome states the amount.
PlanOutcome lock_process_memory(const ThreadPlan& plan);

/// Memory of this process as counted by the kernel; 0 = unknown.
struct MemoryUse {
  std::uint64_t resident_bytes = 0;
  std::uint64_t peak_resident_bytes = 0;
  std::uint64_t locked_bytes = 0;
};
MemoryUse memory_use();

}  // namespace nilio::daemon
