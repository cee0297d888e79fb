// Library for LD_PRELOAD: the odometry thread of niliod hangs after its first poses while the file named by
// NILIO_HANG_FILE exists.
#include "daemon/realtime/thread_hook.hpp"

#include <cstdlib>
#include <unistd.h>

/// See daemon::kPreloadedHook.
extern "C" void nilio_thread_hook(nilio::daemon::ThreadRole role, nilio::daemon::ThreadPhase phase) {
  using namespace nilio::daemon;
  if (role != ThreadRole::kOdometry || phase != ThreadPhase::kWarm) return;
  const char* const file = std::getenv("NILIO_HANG_FILE");
  while (file != nullptr && access(file, F_OK) == 0) usleep(10'000);
}
