#include "packet_clock.hpp"

#include <algorithm>
#include <cstdlib>

namespace nilio::drivers {
namespace {

constexpr std::int64_t kHourUs = 3'600'000'000;
constexpr std::int64_t kHourNs = kHourUs * 1000;
constexpr std::int64_t kReorderWindowNs = 50'000'000;
/// Sensor and host clocks run alike; when their steps differ by more than this, one of them was set.
constexpr std::int64_t kClockSetNs = 500'000'000;
/// Closer than this, sensor time is taken for synchronised with the host's.
constexpr std::int64_t kSynchronisedNs = 200'000'000;

std::int64_t floor_divide(std::int64_t a, std::int64_t b) { return a / b - (a % b < 0 ? 1 : 0); }

/// Difference of two counters modulo one hour, in (-30 min, 30 min].
std::int64_t hour_difference_ns(std::uint32_t now_us, std::uint32_t before_us) {
  std::int64_t difference =
      (static_cast<std::int64_t>(now_us) - static_cast<std::int64_t>(before_us)) % kHourUs;
  if (difference > kHourUs / 2) difference -= kHourUs;
  if (difference <= -kHourUs / 2) difference += kHourUs;
  return difference * 1000;
}

}  // namespace

PacketArrival PacketClock::arrive(std::uint32_t timestamp_us, std::uint16_t first_azimuth, core::Time stamp,
                                  std::int64_t previous_pause_ns) {
  PacketArrival arrival;
  if (!anchored_) {
    anchor(timestamp_us, stamp);
  } else {
    const std::int64_t step_ns = hour_difference_ns(timestamp_us, last_timestamp_us_);
    const std::int64_t host_step_ns = (stamp - last_stamp_).ns;
    if (step_ns <= 0 && step_ns > -kReorderWindowNs) {
      const bool same = step_ns == 0 && first_azimuth == last_azimuth_;
      arrival.order = same ? PacketOrder::kDuplicate : PacketOrder::kReordered;
      return arrival;
    }
    if (step_ns < 0 || std::abs(step_ns - host_step_ns) > kClockSetNs) {
      arrival.order = PacketOrder::kJump;
      anchor(timestamp_us, stamp);
    } else {
      sensor_ns_ += step_ns;
      const std::int64_t periods = (step_ns - previous_pause_ns + packet_period_ns_ / 2) / packet_period_ns_;
      arrival.lost = static_cast<std::uint32_t>(std::max<std::int64_t>(periods - 1, 0));
      refine_shift(stamp);
    }
  }
  last_timestamp_us_ = timestamp_us;
  last_azimuth_ = first_azimuth;
  last_stamp_ = stamp;
  arrival.first_firing_ns = first_firing_ns(stamp);
  return arrival;
}

void PacketClock::anchor(std::uint32_t timestamp_us, core::Time stamp) {
  // Values just beyond the hour do occur at the rollover.
  const std::int64_t past_hour_ns = static_cast<std::int64_t>(timestamp_us) % kHourUs * 1000;
  sensor_ns_ = past_hour_ns + floor_divide(stamp.ns - past_hour_ns + kHourNs / 2, kHourNs) * kHourNs;
  anchored_ = true;
  const bool synchronised = std::abs(sensor_ns_ - stamp.ns) < kSynchronisedNs;
  shift_open_ = source_ == TimeSource::kAuto && !synchronised;
  shift_ns_ = shift_open_ ? stamp.ns - packet_period_ns_ - sensor_ns_ : 0;
}

void PacketClock::refine_shift(core::Time stamp) {
  if (shift_open_) shift_ns_ = std::min(shift_ns_, stamp.ns - packet_period_ns_ - sensor_ns_);
}

std::int64_t PacketClock::first_firing_ns(core::Time stamp) const {
  return source_ == TimeSource::kHost ? stamp.ns - packet_period_ns_ : sensor_ns_;
}

}  // namespace nilio::drivers
