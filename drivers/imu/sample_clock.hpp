#pragma once

#include "nilio/core/time.hpp"

#include "drivers/common/clock_fit.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace nilio::drivers {

/// Converts a device's ticks into host time. Frames can only arrive late, so the ticks are fitted below the
/// times of arrival (ClockFit). The offset follows the fit by at most 0.2 %, which keeps intervals
/// undisturbed. Ticks are reliable between samples, the host's clock beyond 100 ms: after a restart of the
/// device its clock is continued by the host's; when the host's clock is set back, the device's continues.
class ImuSampleClock {
 public:
  /// `tick_ns`: possible lengths of a tick. `wrap`: number of ticks at which the counter wraps, 0 = 2^64.
  ImuSampleClock(std::vector<std::int64_t> tick_ns, std::uint64_t wrap)
      : tick_lengths_ns_(std::move(tick_ns)), wrap_(wrap) {}

  /// Host time of `ticks`, which arrived at `host` (0 to 4e18 ns). Empty in the first half second, and
  /// while no tick length agrees with the host's clock to 5 %.
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
  // Used until the tick length is known.
  core::Time first_host_;
  double ticks_since_first_ = 0.0;
  std::int64_t tick_ns_ = 0;
  // Used once it is known.
  ClockFit fit_;
  std::int64_t device_ns_ = 0;
  std::int64_t offset_ns_ = 0;
  /// Sum of the steps by which the host's clock was set back.
  std::int64_t host_shift_ns_ = 0;
  std::uint64_t jumps_ = 0;
};

}  // namespace nilio::drivers
