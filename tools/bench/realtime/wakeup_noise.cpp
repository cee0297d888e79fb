#include "tools/bench/realtime/wakeup_noise.hpp"

#include "tools/common/monotonic_sleep.hpp"
#include "tools/common/thread_priority.hpp"

#include <algorithm>
#include <sys/prctl.h>

namespace nilio::tools {

namespace {

/// Above niliod's threads: the computer is measured, not what niliod leaves of it.
constexpr int kPriority = 80;

}  // namespace

WakeupNoise::WakeupNoise() : thread_([this] { run(); }) {}

void WakeupNoise::stop() {
  stop_.store(true);
  if (thread_.joinable()) thread_.join();
}

void WakeupNoise::run() {
  fifo_.store(make_this_thread_fifo(kPriority));
  // A normal thread's sleeps are otherwise put off by up to 50 us on purpose.
  prctl(PR_SET_TIMERSLACK, 1UL);
  std::int64_t due = daemon::monotonic_ns() + kPeriod.ns;
  while (!stop_.load(std::memory_order_relaxed)) {
    sleep_until(due);
    const std::int64_t late = std::max<std::int64_t>(daemon::monotonic_ns() - due, 0);
    histogram_->record_corrected(late, kPeriod.ns);
    due += (1 + late / kPeriod.ns) * kPeriod.ns;
  }
}

}  // namespace nilio::tools
