#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace nilio::daemon {

enum class ThreadRole { kLidarReceive, kImuReceive, kDeadlineGuard, kOdometry };
inline constexpr std::size_t kThreadRoles = 4;
/// "nilio-lidar", ...: the thread's name in the kernel, too.
constexpr const char* name_of(ThreadRole role) {
  constexpr std::array<const char*, kThreadRoles> kNames{"nilio-lidar", "nilio-imu", "nilio-guard",
                                                         "nilio-odometry"};
  return kNames[static_cast<std::size_t>(role)];
}

/// Where a real-time thread is in its life.
enum class ThreadPhase {
  kStarted,  ///< has its policy; nothing is prepared yet
  kSteady,   ///< all is prepared; the next thing is the first packet, sample or scan
  kWarm,     ///< of the odometry thread: kWarmUpPoses are out, so velocity and map are established
  kEnding,   ///< the last one is done
};
inline constexpr std::uint64_t kWarmUpPoses = 20;

/// Told by each real-time thread itself, for those that watch what it does; null = nobody asks.
using ThreadHook = void (*)(ThreadRole role, ThreadPhase phase);
/// niliod tells the function of this name, of type ThreadHook and with C linkage, in a library that was
/// preloaded (LD_PRELOAD).
inline constexpr const char* kPreloadedHook = "nilio_thread_hook";

}  // namespace nilio::daemon
