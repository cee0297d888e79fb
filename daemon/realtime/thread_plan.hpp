#pragma once

#include "nilio/core/result.hpp"

#include "daemon/config/config.hpp"
#include "daemon/realtime/cpu_list.hpp"
#include "daemon/realtime/thread_hook.hpp"

#include <array>
#include <cstddef>
#include <string>
#include <sys/types.h>
#include <vector>

namespace nilio::daemon {

/// Scheduling and memory settings of a run, derived from the configuration and the kind of run.
struct ThreadPlan {
  struct Role {
    int priority = 0;
    CpuList cpus;  ///< empty = any
  };

  bool fifo = false;
  bool lock_memory = false;
  bool strict = false;
  /// Threads of the odometry's computation.
  int odometry_threads = 1;
  std::array<Role, kThreadRoles> roles;

  [[nodiscard]] const Role& of(ThreadRole role) const { return roles[static_cast<std::size_t>(role)]; }
};
/// Fails on an invalid CPU list; the error names the key.
core::Result<ThreadPlan> make_thread_plan(const Config& config, bool live);

/// Outcome of one request to the kernel.
struct PlanOutcome {
  bool granted = true;
  std::string text;  ///< "nilio-odometry: FIFO 40 on processor 1", or what was refused, why, and what to do
  /// Granted, but worth a warning.
  bool warns = false;
};

/// Scheduling of a thread.
struct ThreadScheduling {
  int policy = 0;  ///< SCHED_FIFO, SCHED_OTHER ...
  int priority = 0;
  CpuList cpus;
  friend bool operator==(const ThreadScheduling&, const ThreadScheduling&) = default;
};
/// Current scheduling of `thread`; 0 = calling thread.
ThreadScheduling scheduling_of(pid_t thread);

/// Applies the scheduling to the calling thread; check the result with scheduling_of().
void run_as(const ThreadScheduling& scheduling);

/// Touches the stack pages that the thread will use.
void touch_stack();

/// Sets name, policy and CPUs of the calling thread, touches its stack, and reports the scheduling read back
/// from the kernel. Call first in the thread; threads that it starts inherit name and scheduling.
PlanOutcome apply_to_this_thread(const ThreadPlan& plan, ThreadRole role);
/// Checks that `workers`, threads started by the odometry thread, have its scheduling.
PlanOutcome check_workers(const ThreadPlan& plan, const std::vector<pid_t>& workers);
/// Checks the CPU time left for threads that are not FIFO: kernel throttling, and whether the odometry may
/// use all CPUs of the calling thread (the supervisor).
PlanOutcome check_throttling(const ThreadPlan& plan);

}  // namespace nilio::daemon
