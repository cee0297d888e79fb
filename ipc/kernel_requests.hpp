#pragma once

#include <cstddef>
#include <string>

namespace nilio::ipc {

// What both processes ask the kernel for. Each is empty when it is granted, else what the kernel has against
// it and what to grant.

/// The calling thread is SCHED_FIFO of this priority from now on.
std::string request_fifo(int priority);

/// All present and future memory of the process stays resident: no page fault delays anybody.
std::string request_memory_lock();

/// Stack of niliod's real-time threads and the odometry's workers, and of nilio-publisher's where memory is
/// locked: more than any has used, and little enough to lock.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
// Sanitizers keep what they know of a thread on its stack, and make its frames larger.
inline constexpr std::size_t kThreadStackBytes = std::size_t{8} << 20U;
#else
inline constexpr std::size_t kThreadStackBytes = std::size_t{1} << 20U;
#endif

}  // namespace nilio::ipc
