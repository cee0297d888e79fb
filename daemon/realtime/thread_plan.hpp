#pragma once

#include "nilio/core/result.hpp"

#include "daemon/config/config.hpp"
#include "daemon/realtime/run_rules.hpp"
#include "daemon/realtime/thread_hook.hpp"

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <pthread.h>
#include <sched.h>
#include <string>
#include <string_view>
#include <sys/types.h>
#include <vector>

namespace nilio::daemon {

/// Kernel numbers of CPUs, ascending; empty = any.
using CpuList = std::vector<int>;

/// Parses a list in the format of taskset and systemd: "0", "1-2,4" or "". The error names the invalid item;
/// numbers above 1023 are invalid.
core::Result<CpuList> parse_cpu_list(std::string_view text);
/// Inverse of parse_cpu_list(): "1-2,4".
std::string cpu_list_text(const CpuList& cpus);

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
core::Result<ThreadPlan> make_thread_plan(const Config& config, RunRules rules);

/// Outcome of one request to the kernel.
struct PlanOutcome {
  bool granted = true;
  std::string text;  ///< "nilio-odometry: FIFO 40 on CPU 1", or what was refused, why, and what to do
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

/// Thread with a stack of kThreadStackBytes. std::thread's default of 8 MiB would be locked completely in a
/// locked process. Throws std::system_error if no thread can be started.
class PlanThread {
 public:
  explicit PlanThread(std::function<void()> body);
  PlanThread(PlanThread&& other) noexcept = default;
  PlanThread& operator=(PlanThread&&) = delete;
  PlanThread(const PlanThread&) = delete;
  PlanThread& operator=(const PlanThread&) = delete;
  ~PlanThread() = default;

  /// Call exactly once.
  void join();

 private:
  pthread_t thread_{};
  std::unique_ptr<std::function<void()>> body_;
};

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
