#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdlib>

namespace nilio::drivers {

/// A step of the delays that is larger counts as a clock that was set.
inline constexpr std::int64_t kClockSetNs = 50'000'000;

/// Detects that the host's clock was set from the delays of packets whose sensor stamps are regular. A queue
/// delays packets for a while and then drains: a delay that no packet falls below, and that is the same for
/// two windows of a quarter of a second, is no queue.
class HostStepDetector {
 public:
  void restart() { *this = HostStepDetector(); }

  /// `delay_ns`: receive time minus the earliest possible one, of the packet at `line_ns` of the sensor's
  /// time line. Returns the step of the host's clock once it is certain, otherwise 0.
  std::int64_t add(std::int64_t line_ns, std::int64_t delay_ns) {
    std::int64_t step_ns = 0;
    if (count_ > 0 && line_ns - start_ns_ >= kWindowNs) {
      step_ns = close();
      count_ = 0;
    }
    if (count_++ == 0) {
      start_ns_ = line_ns;
      least_ns_ = most_ns_ = delay_ns;
    }
    least_ns_ = std::min(least_ns_, delay_ns);
    most_ns_ = std::max(most_ns_, delay_ns);
    return step_ns;
  }

 private:
  static constexpr std::int64_t kWindowNs = 250'000'000;

  std::int64_t close() {
    const bool off = least_ns_ > kClockSetNs || most_ns_ < -kClockSetNs;
    const std::int64_t step_ns = off ? least_ns_ : 0;
    // The delay of a queue that drains falls by the length of a window.
    const bool again = off && previous_ns_ != 0 && std::abs(step_ns - previous_ns_) < kClockSetNs;
    const std::int64_t result_ns = again ? std::min(step_ns, previous_ns_) : 0;
    previous_ns_ = step_ns;
    return result_ns;
  }

  std::int64_t start_ns_ = 0;
  std::uint64_t count_ = 0;
  std::int64_t least_ns_ = 0;
  std::int64_t most_ns_ = 0;
  std::int64_t previous_ns_ = 0;
};

}  // namespace nilio::drivers
