#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace nilio::daemon {

enum class ThreadRole { kLidarReceive, kImuReceive, kDeadlineGuard, kOdometry };
inline constexpr std::size_t kThreadRoles = 4;
/// "nilio-lidar", ...: also the thread's name in the kernel.
constexpr const char* name_of(ThreadRole role) {
  constexpr std::array<const char*, kThreadRoles> kNames{"nilio-lidar", "nilio-imu", "nilio-guard",
                                                         "nilio-odometry"};
  return kNames[static_cast<std::size_t>(role)];
}

/// Phases in the life of a real-time thread.
enum class ThreadPhase {
  kStarted,  ///< has its scheduling; preparation follows
  kSteady,   ///< prepared; next is the first packet, sample or scan
  kWarm,     ///< odometry thread only: kWarmUpPoses published, velocity and map are established
  kEnding,   ///< last packet, sample or scan processed
};
inline constexpr std::uint64_t kWarmUpPoses = 20;

/// Called by each real-time thread at every phase, for monitoring; null = none.
using ThreadHook = void (*)(ThreadRole role, ThreadPhase phase);
/// niliod calls the C function of this name and type ThreadHook if a preloaded library (LD_PRELOAD) defines
/// it.
inline constexpr const char* kPreloadedHook = "nilio_thread_hook";

}  // namespace nilio::daemon
