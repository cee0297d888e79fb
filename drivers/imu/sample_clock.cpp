#include "drivers/imu/sample_clock.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::drivers {
namespace {

constexpr std::int64_t kProbeNs = 500'000'000;
/// Covers the waits for the bus and the host's scheduler: some milliseconds of the half second of probing.
constexpr double kRateTolerance = 0.05;
constexpr std::int64_t kJumpNs = 100'000'000;
/// The offset changes by at most one part in this number.
constexpr std::int64_t kSlewDivisor = 500;
/// Longest pause between samples while the host's clock was set back; a longer one is a restarted device.
constexpr std::int64_t kLongestPauseNs = 10'000'000'000;
/// Limit that keeps sums within 64 bits.
constexpr std::int64_t kLargestShiftNs = 1'000'000'000'000'000'000;

}  // namespace

void ImuSampleClock::restart(std::uint64_t ticks, core::Time host) {
  started_ = true;
  last_ticks_ = ticks;
  first_host_ = last_host_ = host;
  ticks_since_first_ = 0.0;
  tick_ns_ = 0;
  fit_.restart();
  device_ns_ = 0;
  host_shift_ns_ = 0;
}

std::uint64_t ImuSampleClock::elapsed_ticks(std::uint64_t ticks) const {
  // Unsigned arithmetic is modulo 2^64 by itself.
  if (wrap_ == 0 || ticks >= last_ticks_) return ticks - last_ticks_;
  return ticks + (wrap_ - last_ticks_);
}

std::optional<core::Time> ImuSampleClock::stamp(std::uint64_t ticks, core::Time host) {
  if (wrap_ != 0) ticks %= wrap_;
  if (!started_ || host_shift_ns_ > kLargestShiftNs) {
    restart(ticks, host);
    return std::nullopt;
  }
  const std::uint64_t elapsed = elapsed_ticks(ticks);
  const std::int64_t host_step_ns = (host - last_host_).ns;
  last_ticks_ = ticks;
  last_host_ = host;
  if (tick_ns_ == 0) {
    ticks_since_first_ += static_cast<double>(elapsed);
    find_tick_length(host);
    return std::nullopt;
  }
  const std::int64_t step_ns = advance(elapsed, host_step_ns);
  const bool first = fit_.empty();
  fit_.observe(device_ns_, host.ns + host_shift_ns_ - device_ns_);
  const std::int64_t wanted = fit_.offset_at(device_ns_);
  const std::int64_t most = step_ns / kSlewDivisor;
  offset_ns_ = first ? wanted : offset_ns_ + std::clamp(wanted - offset_ns_, -most, most);
  return core::Time{device_ns_ + offset_ns_};
}

/// After half a second, compares the host's clock with each possible tick length; restarts when none fits.
void ImuSampleClock::find_tick_length(core::Time host) {
  const std::int64_t elapsed_ns = (host - first_host_).ns;
  if (elapsed_ns >= 0 && elapsed_ns < kProbeNs) return;
  for (const std::int64_t candidate : tick_lengths_ns_) {
    const double by_device = ticks_since_first_ * static_cast<double>(candidate);
    if (std::abs(by_device - static_cast<double>(elapsed_ns)) >
        kRateTolerance * static_cast<double>(elapsed_ns)) {
      continue;
    }
    tick_ns_ = candidate;
    return;
  }
  restart(last_ticks_, host);
}

/// Advances the device's time by a plausible step and returns the step.
std::int64_t ImuSampleClock::advance(std::uint64_t elapsed, std::int64_t host_step_ns) {
  const double by_device = static_cast<double>(elapsed) * static_cast<double>(tick_ns_);
  const bool agree = std::abs(by_device - static_cast<double>(host_step_ns)) <= static_cast<double>(kJumpNs);
  const bool is_pause = by_device <= static_cast<double>(kLongestPauseNs);
  if (!agree) ++jumps_;
  // When they disagree, the host counts, unless it was set back and the device was not.
  std::int64_t step_ns = std::max<std::int64_t>(host_step_ns, 0);
  if (agree || (host_step_ns < 0 && is_pause)) step_ns = static_cast<std::int64_t>(by_device);
  if (!agree && host_step_ns < 0) host_shift_ns_ += step_ns - host_step_ns;
  device_ns_ += step_ns;
  return step_ns;
}

}  // namespace nilio::drivers
