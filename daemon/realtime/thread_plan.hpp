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

/// How the threads shall run, from the configuration and the kind of run.
struct ThreadPlan {
  struct Role {
    int priority = 0;
    CpuList cpus;  ///< empty = any
  };

  bool fifo = false;
  bool lock_memory = false;
  bool strict = false;
  /// Threads that the odometry computes with.
  int odometry_threads = 1;
  std::array<Role, kThreadRoles> roles;

  [[nodiscard]] const Role& of(ThreadRole role) const { return roles[static_cast<std::size_t>(role)]; }
};
/// Fails on a list of processors that is none, naming the key.
core::Result<ThreadPlan> make_thread_plan(const Config& config, bool live);

/// What one request to the kernel came to.
struct PlanOutcome {
  bool granted = true;
  std::string text;  ///< "nilio-odometry: FIFO 40 on processor 1", or what was refused, why, and what to do
  /// Granted, but to be warned of.
  bool warns = false;
};

/// How the kernel runs a thread.
struct ThreadScheduling {
  int policy = 0;  ///< SCHED_FIFO, SCHED_OTHER ...
  int priority = 0;
  CpuList cpus;
  friend bool operator==(const ThreadScheduling&, const ThreadScheduling&) = default;
};
/// Asks the kernel; `thread` = 0 is the calling one.
ThreadScheduling scheduling_of(pid_t thread);

/// Has the calling thread run like that; what came of it, scheduling_of() tells.
void run_as(const ThreadScheduling& scheduling);

/// Touches the pages of the stack that the thread will use.
void touch_stack();

/// Names the calling thread, gives it its policy and processors, touches its stack, and says what the kernel
/// then says it has. To be called first in the thread, before it starts others, which inherit both.
PlanOutcome apply_to_this_thread(const ThreadPlan& plan, ThreadRole role);
/// Whether `workers`, threads that the odometry thread has started, run as it does.
PlanOutcome judge_workers(const ThreadPlan& plan, const std::vector<pid_t>& workers);
/// What the kernel leaves to all threads that are not FIFO: its throttling, and whether the odometry may take
/// all processors that the calling thread, the supervisor, has.
PlanOutcome judge_throttling(const ThreadPlan& plan);

}  // namespace nilio::daemon
