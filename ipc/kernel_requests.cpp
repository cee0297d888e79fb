#include "ipc/kernel_requests.hpp"

#include <cerrno>
#include <cstring>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>

namespace nilio::ipc {

std::string request_fifo(int priority) {
  const sched_param parameters{priority};
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
  if (error == 0) return {};
  return "FIFO " + std::to_string(priority) + " refused (" + std::strerror(error) +
         "): grant CAP_SYS_NICE or LimitRTPRIO=" + std::to_string(priority);
}

std::string request_memory_lock() {
  if (mlockall(MCL_CURRENT | MCL_FUTURE) == 0) return {};
  return std::string("locking refused (") + std::strerror(errno) +
         "): page faults may delay poses; grant CAP_IPC_LOCK or LimitMEMLOCK=infinity";
}

}  // namespace nilio::ipc
