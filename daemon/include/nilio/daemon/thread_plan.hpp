#pragma once

#include "nilio/daemon/config.hpp"

#include <string>
#include <vector>

namespace nilio::daemon {

enum class ThreadRole { kLidarReceive, kImuReceive, kDeadlineGuard, kOdometry };

/// How the threads shall run, from the configuration and the kind of run.
struct ThreadPlan {
  bool fifo = false;
  bool lock_memory = false;
  bool strict = false;
  int lidar_priority = 0;
  int imu_priority = 0;
  int odometry_priority = 0;
};
ThreadPlan make_thread_plan(const RealtimeSection& config, bool live);

/// What one request to the kernel came to.
struct PlanOutcome {
  bool granted = true;
  std::string text;  ///< "odometry: FIFO 40", or what was refused, why, and what to do
};

/// Names the calling thread and gives it its policy. To be called first in the thread, before it starts
/// others.
PlanOutcome apply_to_this_thread(const ThreadPlan& plan, ThreadRole role);
/// Locks all present and future memory of the process.
PlanOutcome lock_process_memory(const ThreadPlan& plan);

}  // namespace nilio::daemon
