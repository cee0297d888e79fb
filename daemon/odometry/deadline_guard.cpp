#include "daemon/odometry/deadline_guard.hpp"

#include "nilio/core/clock.hpp"

#include "daemon/odometry/odometry_loop.hpp"

#include <cerrno>
#include <cstring>
#include <ctime>
#include <string>
#include <sys/timerfd.h>
#include <unistd.h>
#include <utility>

namespace nilio::daemon {

core::Result<std::unique_ptr<DeadlineGuard>> DeadlineGuard::create(Publish publish) {
  const int timer = timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC);
  if (timer < 0) return core::Error{std::string("deadline guard: no timer: ") + std::strerror(errno)};
  std::unique_ptr<DeadlineGuard> guard(new DeadlineGuard(timer, std::move(publish)));
  guard->set_timer(1);
  return guard;
}

DeadlineGuard::~DeadlineGuard() { close(timer_); }

void DeadlineGuard::set_timer(std::int64_t at_ns) const {
  // Zero would disarm the timer.
  const std::int64_t at = at_ns > 0 ? at_ns : 1;
  // The repetition shows that the thread is alive.
  const itimerspec wanted{{0, kLongestWait.ns}, to_timespec({at})};
  timerfd_settime(timer_, TFD_TIMER_ABSTIME, &wanted, nullptr);
}

void DeadlineGuard::arm(const ipc::PoseRecord& prediction, std::int64_t deadline_ns,
                        std::int64_t publish_ns) {
  prediction_ = prediction;
  deadline_ns_ = deadline_ns;
  publish_ns_.store(publish_ns, std::memory_order_relaxed);
  state_.store(State::kArmed, std::memory_order_release);
  set_timer(publish_ns);
}

bool DeadlineGuard::claim() {
  State expected = State::kArmed;
  if (state_.compare_exchange_strong(expected, State::kIdle, std::memory_order_acq_rel)) return true;
  // The guard has the higher priority: it has finished already, or runs on another core.
  while (state_.load(std::memory_order_acquire) != State::kPublished) {
    const timespec pause{0, 20'000};
    nanosleep(&pause, nullptr);
  }
  state_.store(State::kIdle, std::memory_order_relaxed);
  return false;
}

bool DeadlineGuard::run() {
  std::uint64_t expirations = 0;
  const bool expired = read(timer_, &expirations, sizeof expirations) == sizeof expirations;
  if (stop_.load(std::memory_order_relaxed)) return false;
  // The timer may still be set for a scan that was claimed in the meantime.
  if (!expired || monotonic_ns() < publish_ns_.load(std::memory_order_relaxed)) return true;
  State expected = State::kArmed;
  if (!state_.compare_exchange_strong(expected, State::kPublishing, std::memory_order_acq_rel)) return true;
  stamp_delivery(prediction_);
  prediction_.has_deadline = true;
  prediction_.overshoot_ns = prediction_.stage_time_ns(ipc::Stage::kDelivered) - deadline_ns_;
  publish_(prediction_);
  state_.store(State::kPublished, std::memory_order_release);
  return true;
}

void DeadlineGuard::stop() {
  stop_.store(true, std::memory_order_relaxed);
  set_timer(1);
}

}  // namespace nilio::daemon
