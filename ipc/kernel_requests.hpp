#pragma once

#include <cerrno>
#include <cstddef>
#include <cstring>
#include <pthread.h>
#include <sched.h>
#include <string>
#include <sys/mman.h>

namespace nilio::ipc {

// Requests of both processes to the kernel. The result is empty if granted, otherwise the refusal and its
// remedy.

/// Sets the calling thread to SCHED_FIFO with this priority.
inline std::string request_fifo(int priority) {
  const sched_param parameters{priority};
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
  if (error == 0) return {};
  return "FIFO " + std::to_string(priority) + " refused (" + std::strerror(error) +
         "): grant CAP_SYS_NICE or LimitRTPRIO=" + std::to_string(priority);
}

/// Returns the calling thread to normal scheduling, which needs no privilege; its nice value is kept.
inline void leave_fifo() {
  const sched_param normal{};
  pthread_setschedparam(pthread_self(), SCHED_OTHER, &normal);
}

/// Locks all present and future memory of the process, which avoids page faults.
inline std::string request_memory_lock() {
  if (mlockall(MCL_CURRENT | MCL_FUTURE) == 0) return {};
  return std::string("locking refused (") + std::strerror(errno) +
         "): page faults may delay poses; grant CAP_IPC_LOCK or LimitMEMLOCK=infinity";
}

/// Stack size of niliod's real-time threads and the odometry's workers, and of nilio-publisher's threads if
/// memory is locked. Larger than any measured use and small enough to lock.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
// Sanitizers keep data on the thread's stack and enlarge its frames.
inline constexpr std::size_t kThreadStackBytes = std::size_t{8} << 20U;
#else
inline constexpr std::size_t kThreadStackBytes = std::size_t{1} << 20U;
#endif

}  // namespace nilio::ipc
