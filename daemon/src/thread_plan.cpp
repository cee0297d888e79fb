#include "nilio/daemon/thread_plan.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <malloc.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>

namespace nilio::daemon {

namespace {

struct RoleSettings {
  const char* name;
  int priority;
};

RoleSettings settings_of(const ThreadPlan& plan, ThreadRole role) {
  switch (role) {
    case ThreadRole::kLidarReceive:
      return {"nilio-lidar", plan.lidar_priority};
    case ThreadRole::kImuReceive:
      return {"nilio-imu", plan.imu_priority};
    case ThreadRole::kDeadlineGuard:
      // It must get the core from the registration that is late.
      return {"nilio-guard", std::min(plan.odometry_priority + 1, sched_get_priority_max(SCHED_FIFO))};
    case ThreadRole::kOdometry:
      return {"nilio-odometry", plan.odometry_priority};
  }
  return {"nilio", 0};
}

}  // namespace

ThreadPlan make_thread_plan(const RealtimeSection& config, bool live) {
  ThreadPlan plan;
  plan.fifo = config.policy == "fifo" || (config.policy == "auto" && live);
  plan.lock_memory = config.lock_memory && live;
  plan.strict = config.strict;
  plan.lidar_priority = config.lidar_priority;
  plan.imu_priority = config.imu_priority;
  plan.odometry_priority = config.odometry_priority;
  return plan;
}

PlanOutcome apply_to_this_thread(const ThreadPlan& plan, ThreadRole role) {
  const RoleSettings settings = settings_of(plan, role);
  pthread_setname_np(pthread_self(), settings.name);
  const std::string name(settings.name);
  if (!plan.fifo) return {true, name + ": normal scheduling"};
  const sched_param parameters{settings.priority};
  const std::string wanted = name + ": FIFO " + std::to_string(settings.priority);
  if (const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters); error != 0) {
    return {false, wanted + " refused (" + std::strerror(error) +
                       "): runs at normal priority; grant CAP_SYS_NICE or LimitRTPRIO"};
  }
  return {true, wanted};
}

PlanOutcome lock_process_memory(const ThreadPlan& plan) {
  if (!plan.lock_memory) return {true, "memory: not locked"};
  // Freed memory stays mapped and locked, and no allocation makes a mapping of its own.
  mallopt(M_TRIM_THRESHOLD, -1);
  mallopt(M_MMAP_MAX, 0);
  if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    return {false, std::string("memory: locking refused (") + std::strerror(errno) +
                       "): page faults may delay poses; grant CAP_IPC_LOCK or LimitMEMLOCK"};
  }
  return {true, "memory: locked"};
}

}  // namespace nilio::daemon
