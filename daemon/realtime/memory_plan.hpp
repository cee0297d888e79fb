#pragma once

#include "daemon/realtime/thread_plan.hpp"

#include <cstdint>

namespace nilio::daemon {

/// Has the heap keep what it has: freed memory stays mapped, no allocation makes a mapping of its own, and
/// all threads share one arena, so that what was touched once is there for good. To be called before threads
/// start; of no effect when the plan does not lock memory.
void prepare_heap(const ThreadPlan& plan);

/// Locks all present and future memory of the process; says how much that is.
PlanOutcome lock_process_memory(const ThreadPlan& plan);

/// Of this process, as the kernel counts them now; 0 where it does not say.
struct MemoryUse {
  std::uint64_t resident_bytes = 0;
  std::uint64_t peak_resident_bytes = 0;
  std::uint64_t locked_bytes = 0;
};
MemoryUse memory_use();

}  // namespace nilio::daemon
