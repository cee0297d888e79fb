#pragma once

#include "nilio/core/clock.hpp"
#include "nilio/core/time.hpp"

#include "ipc/histogram.hpp"
#include "tools/common/system.hpp"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <memory>
#include <sys/prctl.h>
#include <thread>

namespace nilio::tools::bench {

/// Wake-up latency of the computer, as cyclictest measures it: delay of a thread that sleeps until absolute
/// times. A lower bound for every program on it. Measures from construction to stop().
class WakeupLatency {
 public:
  static constexpr core::Duration kPeriod = core::Duration::from_milliseconds(1.0);

  WakeupLatency() : thread_([this] { run(); }) {}
  WakeupLatency(const WakeupLatency&) = delete;
  WakeupLatency& operator=(const WakeupLatency&) = delete;
  ~WakeupLatency() { stop(); }

  /// Ends the measurement. May be called again.
  void stop() {
    stop_.store(true);
    if (thread_.joinable()) thread_.join();
  }
  /// Latency of each period, nanoseconds; periods during which the thread did not run count too.
  [[nodiscard]] const ipc::Histogram& histogram() const { return *histogram_; }
  /// True when the thread runs under SCHED_FIFO; otherwise the figures are those of a normal thread.
  [[nodiscard]] bool is_fifo() const { return fifo_.load(); }

 private:
  void run() {
    constexpr int priority = 80;  // above niliod's threads: measures the computer, not niliod's load
    fifo_.store(make_this_thread_fifo(priority));
    prctl(PR_SET_TIMERSLACK, 1UL);  // the default delays a normal thread by up to 50 us
    std::int64_t due = monotonic_ns() + kPeriod.ns;
    while (!stop_.load(std::memory_order_relaxed)) {
      sleep_until(due);
      const std::int64_t late = std::max<std::int64_t>(monotonic_ns() - due, 0);
      histogram_->record_corrected(late, kPeriod.ns);
      due += (1 + late / kPeriod.ns) * kPeriod.ns;
    }
  }

  std::unique_ptr<ipc::Histogram> histogram_ = std::make_unique<ipc::Histogram>();
  std::atomic<bool> stop_{false};
  std::atomic<bool> fifo_{false};
  std::thread thread_;
};

}  // namespace nilio::tools::bench
