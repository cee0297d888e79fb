#pragma once

#include <cstddef>
#include <string>

namespace nilio::ipc {

// Requests of both processes to the kernel. The result is empty if granted, otherwise the refusal and its
// remedy.

/// Sets the calling thread to SCHED_FIFO with this priority.
std::string request_fifo(int priority);

/// Locks all present and future memory of the process, which avoids page faults.
std::string request_memory_lock();

/// Stack size of niliod's real-time threads and the odometry's workers, and of nilio-publisher's threads if
/// memory is locked. Larger than any measured use and small enough to lock.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
// Sanitizers keep data on the thread's stack and enlarge its frames.
inline constexpr std::size_t kThreadStackBytes = std::size_t{8} << 20U;
#else
inline constexpr std::size_t kThreadStackBytes = std::size_t{1} << 20U;
#endif

}  // namespace nilio::ipc
