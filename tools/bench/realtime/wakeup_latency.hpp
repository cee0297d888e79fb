#pragma once

#include "nilio/core/time.hpp"

#include "ipc/histogram.hpp"

#include <atomic>
#include <cstdint>
#include <memory>
#include <thread>

namespace nilio::tools {

/// How late the computer wakes a thread that sleeps to absolute times, as cyclictest measures it: what no
/// program on it can do better than. Measures from construction to stop().
class WakeupNoise {
 public:
  static constexpr core::Duration kPeriod = core::Duration::from_milliseconds(1.0);

  WakeupNoise();
  WakeupNoise(const WakeupNoise&) = delete;
  WakeupNoise& operator=(const WakeupNoise&) = delete;
  ~WakeupNoise() { stop(); }

  /// Ends the measurement; more than once does no harm.
  void stop();
  /// Lateness of each period's wake-up; periods that were slept through count as what they were late.
  [[nodiscard]] const ipc::Histogram& histogram() const { return *histogram_; }
  /// The thread was given SCHED_FIFO; without it the figures are those of a normal thread.
  [[nodiscard]] bool is_fifo() const { return fifo_.load(); }

 private:
  void run();

  std::unique_ptr<ipc::Histogram> histogram_ = std::make_unique<ipc::Histogram>();
  std::atomic<bool> stop_{false};
  std::atomic<bool> fifo_{false};
  std::thread thread_;
};

}  // namespace nilio::tools
