#include "daemon/realtime/startup_priority.hpp"

#include <sched.h>

namespace nilio::daemon {

StartupPriority::StartupPriority() {
  const sched_param lowest{sched_get_priority_min(SCHED_FIFO)};
  granted_ = sched_getscheduler(0) == SCHED_OTHER &&
             sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &lowest) == 0;
}

StartupPriority::~StartupPriority() {
  const sched_param normal{0};
  // Only CAP_SYS_NICE may take the flag away.
  if (granted_) sched_setscheduler(0, SCHED_OTHER | SCHED_RESET_ON_FORK, &normal);
}

}  // namespace nilio::daemon
