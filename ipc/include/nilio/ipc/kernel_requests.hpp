#pragma once

#include <string>

namespace nilio::ipc {

// What both processes ask the kernel for. Each is empty when it is granted, else what the kernel has against
// it and what to grant.

/// The calling thread is SCHED_FIFO of this priority from now on.
std::string request_fifo(int priority);

/// All present and future memory of the process stays resident: no page fault delays anybody.
std::string request_memory_lock();

}  // namespace nilio::ipc
