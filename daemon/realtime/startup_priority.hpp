#pragma once

#include <sched.h>

namespace nilio::daemon {

/// Runs the calling thread at the lowest FIFO priority during its lifetime, so that busy programs do not
/// delay the start, in which packets already arrive. Threads and processes started meanwhile have normal
/// scheduling. Without the permission nothing changes; the FIFO threads report that.
class StartupPriority {
 public:
  StartupPriority() {
    const sched_param lowest{sched_get_priority_min(SCHED_FIFO)};
    granted_ = sched_getscheduler(0) == SCHED_OTHER &&
               sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &lowest) == 0;
  }
  StartupPriority(const StartupPriority&) = delete;
  StartupPriority& operator=(const StartupPriority&) = delete;
  ~StartupPriority() {
    const sched_param normal{0};
    // Only CAP_SYS_NICE may take the flag away.
    if (granted_) sched_setscheduler(0, SCHED_OTHER | SCHED_RESET_ON_FORK, &normal);
  }

 private:
  bool granted_ = false;
};

}  // namespace nilio::daemon
