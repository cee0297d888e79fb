#pragma once

#include <pthread.h>
#include <sched.h>

namespace nilio::tools {

/// SCHED_FIFO for the calling thread; false where that is not allowed (it takes CAP_SYS_NICE or
/// RLIMIT_RTPRIO).
inline bool make_this_thread_fifo(int priority) {
  sched_param parameters{};
  parameters.sched_priority = priority;
  return pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters) == 0;
}

}  // namespace nilio::tools
