#pragma once

#include "nilio/core/time.hpp"

#include "drivers/common/clock_fit.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace nilio::drivers {

/// Turns a device's ticks into host time: frames can only come late, so the ticks are fitted under the times
/// of arrival (ClockFit). The fit is followed by at most 0.2 % so that it does not disturb intervals. The
/// ticks are taken to be right between samples and the host over 100 ms: when the device starts again, its
/// clock is continued by the host's; when the host's clock is set back, the device's goes on.
class ImuSampleClock {
 public:
  /// `tick_ns`: the lengths that a tick may have. `wrap`: ticks after which the device begins again, 0 =
  /// 2^64.
  ImuSampleClock(std::vector<std::int64_t> tick_ns, std::uint64_t wrap)
      : tick_lengths_ns_(std::move(tick_ns)), wrap_(wrap) {}

  /// Host time of `ticks`, which arrived at `host` (0 to 4e18 ns). Nothing in the first half second, and
  /// while no length of a tick agrees with the host's clock to 5 %.
  std::optional<core::Time> stamp(std::uint64_t ticks, core::Time host);
  [[nodiscard]] std::uint64_t jumps() const { return jumps_; }

 private:
  void restart(std::uint64_t ticks, core::Time host);
  void find_tick_length(core::Time host);
  [[nodiscard]] std::uint64_t elapsed_ticks(std::uint64_t ticks) const;
  std::int64_t advance(std::uint64_t elapsed, std::int64_t host_step_ns);

  std::vector<std::int64_t> tick_lengths_ns_;
  std::uint64_t wrap_;
  bool started_ = false;
  std::uint64_t last_ticks_ = 0;
  core::Time last_host_;
  // Until the length of a tick is known.
  core::Time first_host_;
  double ticks_since_first_ = 0.0;
  std::int64_t tick_ns_ = 0;
  // From then on.
  ClockFit fit_;
  std::int64_t device_ns_ = 0;
  std::int64_t offset_ns_ = 0;
  /// What was taken off the host's clock when it was set back.
  std::int64_t host_shift_ns_ = 0;
  std::uint64_t jumps_ = 0;
};

}  // namespace nilio::drivers
