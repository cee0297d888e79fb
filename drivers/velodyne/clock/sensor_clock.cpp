#include "drivers/velodyne/clock/sensor_clock.hpp"

#include "nilio/core/units.hpp"

#include <algorithm>
#include <cstdlib>

namespace nilio::drivers {
namespace {

constexpr std::int64_t kHourNs = kHourUs * 1000;
/// A packet cannot arrive before it was sent. The earliest arrival so far may itself have been this late.
constexpr std::int64_t kEarlyNs = 10'000'000;
/// An earlier arrival after a gap may be a damaged stamp and does not enter the fit.
constexpr std::int64_t kFittedEarlyNs = 500'000;
/// Longest delay by a network. A gap in the stamps that took longer by so much is none.
constexpr std::int64_t kLateNs = 500'000'000;
/// Of a sensor without a clock: a larger step of receive times is a host's clock that was set.
constexpr std::int64_t kHostStepBackNs = 500'000'000;
constexpr std::int64_t kHostStepForwardNs = 2 * kNanosecondsPerSecond;
/// Within this difference sensor time counts as synchronised with the host's.
constexpr std::int64_t kSynchronisedNs = 200'000'000;
/// Largest rate at which the shift follows the fit.
constexpr double kSlew = 200e-6;
/// Validity of a GPS report; position packets arrive many times a second.
constexpr std::int64_t kReportLifetimeNs = 5 * kNanosecondsPerSecond;

std::int64_t floor_divide(std::int64_t a, std::int64_t b) { return a / b - (a % b < 0 ? 1 : 0); }

/// True if the stamps advance by one packet at most (a pause included, which is known to a twentieth), or go
/// back within the reorder window.
bool is_regular(std::int64_t step_ns, std::int64_t period_ns, std::int64_t pause_ns) {
  return step_ns > -kReorderWindowNs && step_ns <= period_ns + period_ns / 2 + pause_ns + pause_ns / 20;
}

}  // namespace

PacketArrival SensorClock::arrive(std::uint32_t timestamp_us, std::uint16_t first_azimuth, core::Time stamp,
                                  std::int64_t previous_pause_ns, std::uint64_t copy_key) {
  if (!has_clock_) return arrive_without_clock(stamp, copy_key);
  const Seen packet{timestamp_us, first_azimuth, on_time_line(stamp)};
  if (!anchored_) {
    anchor(packet);
    remember(packet);
    PacketArrival arrival;
    arrival.line_ns = line_ns_;
    return arrival;
  }
  const std::int64_t step_ns = hour_difference_ns(timestamp_us, last_.timestamp_us);
  if (is_wrong_hour(line_ns_ + step_ns, packet.stamp)) {
    PacketArrival arrival;
    arrival.order = PacketOrder::kJump;
    arrival.refutes = unconfirmed_.has_value();
    return arrival;
  }
  if (!follows(packet, previous_pause_ns)) return contradict(packet);
  PacketArrival arrival;
  if (step_ns <= 0) {
    arrival.order = was_seen(packet) ? PacketOrder::kDuplicate : PacketOrder::kLate;
    arrival.line_ns = line_ns_ + step_ns;
    seen_[seen_count_++ % kSeen] = packet;
    return arrival;
  }
  return advance(packet, previous_pause_ns);
}

PacketArrival SensorClock::advance(const Seen& packet, std::int64_t previous_pause_ns) {
  PacketArrival arrival;
  const std::int64_t step_ns = hour_difference_ns(packet.timestamp_us, last_.timestamp_us);
  line_ns_ += step_ns;
  arrival.line_ns = line_ns_;
  arrival.since_previous_ns = step_ns;
  // The azimuth gives the pause to a few per cent.
  const std::int64_t unexplained_ns = step_ns - previous_pause_ns - previous_pause_ns / 20;
  const std::int64_t periods = (unexplained_ns + packet_period_ns_ / 2) / packet_period_ns_;
  arrival.gap_packets = static_cast<std::uint32_t>(std::max<std::int64_t>(periods - 1, 0));
  arrival.refutes = unconfirmed_.has_value();
  // The packet with the damaged stamp fills one place.
  if (arrival.refutes && arrival.gap_packets > 0) --arrival.gap_packets;
  unconfirmed_.reset();
  const std::int64_t host_shift_ns = host_shift_ns_;
  const bool is_next = is_regular(step_ns, packet_period_ns_, previous_pause_ns);
  arrival.host_jump = observe(packet, is_next ? kClockSetNs : kFittedEarlyNs);
  remember({packet.timestamp_us, packet.azimuth, {packet.stamp.ns + host_shift_ns_ - host_shift_ns}});
  return arrival;
}

/// A packet that does not follow the previous one.
PacketArrival SensorClock::contradict(const Seen& packet) {
  PacketArrival arrival;
  if (unconfirmed_) {
    const std::int64_t step_ns = hour_difference_ns(packet.timestamp_us, unconfirmed_->timestamp_us);
    const std::int64_t host_step_ns = (packet.stamp - unconfirmed_->stamp).ns;
    if (step_ns == 0 && packet.azimuth == unconfirmed_->azimuth) {
      arrival.order = PacketOrder::kDuplicate;
      return arrival;
    }
    const bool lost_between = step_ns > 0 && std::abs(step_ns - host_step_ns) < kLateNs;
    if (is_regular(step_ns, packet_period_ns_, 0) || lost_between) {
      arrival.order = PacketOrder::kConfirmed;
      return arrival;
    }
  }
  arrival.order = PacketOrder::kUnconfirmed;
  arrival.refutes = unconfirmed_.has_value();
  unconfirmed_ = packet;
  return arrival;
}

PacketArrival SensorClock::confirm(std::int64_t previous_pause_ns) {
  const Seen packet = *unconfirmed_;
  unconfirmed_.reset();
  const std::int64_t step_ns = hour_difference_ns(packet.timestamp_us, last_.timestamp_us);
  // Packets were lost, and those before were all a little late.
  if (step_ns > 0 && is_gap(packet, kClockSetNs)) return advance(packet, previous_pause_ns);
  PacketArrival arrival;
  arrival.order = PacketOrder::kJump;
  return arrival;
}

std::int64_t SensorClock::restart(std::uint32_t timestamp_us, std::uint16_t first_azimuth, core::Time stamp) {
  const Seen packet{timestamp_us, first_azimuth, on_time_line(stamp)};
  anchor(packet);
  // A clock that was set agrees with the host's by chance only, unless GPS has set it.
  if (source_ == TimeSource::kAuto) in_step_ = in_step_ && gps_ && gps_->pulse_locked;
  remember(packet);
  return line_ns_;
}

/// Smooths receive times minus a packet's duration: packets have an even rate.
PacketArrival SensorClock::arrive_without_clock(core::Time stamp, std::uint64_t copy_key) {
  constexpr std::int64_t kLockNs = 5'000'000;
  constexpr std::int64_t kSmoothing = 16;
  constexpr std::size_t kLatestKeys = 128;
  const std::int64_t observed_ns = stamp.ns - packet_period_ns_;
  PacketArrival arrival;
  for (std::size_t i = 1; copy_key != 0 && i <= std::min(seen_count_, kLatestKeys); ++i) {
    if (copy_keys_[(seen_count_ - i) % kSeen] != copy_key) continue;
    arrival.order = PacketOrder::kDuplicate;
    return arrival;
  }
  copy_keys_[seen_count_++ % kSeen] = copy_key;
  if (!anchored_) {
    line_ns_ = observed_ns;
    anchored_ = true;
  } else {
    const std::int64_t predicted_ns = line_ns_ + packet_period_ns_;
    const std::int64_t error_ns = observed_ns - predicted_ns;
    const std::int64_t next_ns =
        std::abs(error_ns) < kLockNs ? predicted_ns + error_ns / kSmoothing : observed_ns;
    if (error_ns < -kHostStepBackNs || error_ns > kHostStepForwardNs) {
      arrival.host_jump = true;
      // Time must not go back.
      shift_ns_ += std::max<std::int64_t>(predicted_ns - next_ns, 0);
    } else {
      arrival.since_previous_ns = std::max<std::int64_t>(next_ns - line_ns_, 1);
    }
    line_ns_ = arrival.host_jump ? next_ns : line_ns_ + arrival.since_previous_ns;
  }
  arrival.line_ns = line_ns_;
  return arrival;
}

/// Copies arrive soon after the original: the search begins with the latest packet.
bool SensorClock::was_seen(const Seen& packet) const {
  for (std::size_t i = 1; i <= std::min(seen_count_, kSeen); ++i) {
    const Seen& seen = seen_[(seen_count_ - i) % kSeen];
    if (seen.timestamp_us == packet.timestamp_us && seen.azimuth == packet.azimuth) return true;
  }
  return false;
}

/// True if the packet's stamp is possible after the previous one.
bool SensorClock::follows(const Seen& packet, std::int64_t previous_pause_ns) const {
  const std::int64_t step_ns = hour_difference_ns(packet.timestamp_us, last_.timestamp_us);
  if (is_regular(step_ns, packet_period_ns_, previous_pause_ns)) return true;
  return step_ns > 0 && is_gap(packet, kEarlyNs);
}

/// True if lost packets explain a step of the stamps: the packet arrives no earlier than others do, to
/// `early_ns`, and was not under way much longer than the previous one.
bool SensorClock::is_gap(const Seen& packet, std::int64_t early_ns) const {
  const std::int64_t step_ns = hour_difference_ns(packet.timestamp_us, last_.timestamp_us);
  const std::int64_t delay = delay_ns(packet, line_ns_ + step_ns);
  // Negative after the host's clock was set back.
  const std::int64_t previous = delay_ns(last_, line_ns_);
  return delay - std::min<std::int64_t>(previous, 0) > -early_ns && delay - previous < kLateNs;
}

/// Time from the earliest possible arrival to the actual one.
std::int64_t SensorClock::delay_ns(const Seen& packet, std::int64_t line_ns) const {
  return packet.stamp.ns - packet_period_ns_ - line_ns - fit_.offset_at(line_ns);
}

void SensorClock::remember(const Seen& packet) {
  seen_[seen_count_++ % kSeen] = packet;
  last_ = packet;
}

/// True when sensor time is configured and a locked receiver provides the hour.
bool SensorClock::has_gps_hour(core::Time stamp) const {
  return source_ == TimeSource::kSensor && gps_ && gps_->pulse_locked && gps_->utc &&
         std::abs((stamp - gps_received_).ns) < kReportLifetimeNs;
}

/// True when the hour taken from the host differs from that of a later position packet.
bool SensorClock::is_wrong_hour(std::int64_t line_ns, core::Time stamp) const {
  return has_gps_hour(stamp) && std::abs(line_ns - gps_->utc->ns) > kHourNs / 2 + kReportLifetimeNs;
}

void SensorClock::anchor(const Seen& packet) {
  const core::Time about = has_gps_hour(packet.stamp) ? *gps_->utc : packet.stamp;
  // Values slightly beyond one hour occur at the rollover.
  const std::int64_t past_hour_ns = static_cast<std::int64_t>(packet.timestamp_us) % kHourUs * 1000;
  line_ns_ = past_hour_ns + floor_divide(about.ns - past_hour_ns + kHourNs / 2, kHourNs) * kHourNs;
  anchored_ = true;
  agrees_ = std::abs(line_ns_ - packet.stamp.ns) < kSynchronisedNs;
  in_step_ = source_ == TimeSource::kSensor || (source_ == TimeSource::kAuto && agrees_);
  unconfirmed_.reset();
  seen_count_ = 0;
  fit_.restart();
  host_steps_.restart();
  shift_ns_ = 0;
  shift_free_ = true;
  observe(packet, 0);
}

/// Adds the packet's delay to the fit, unless it arrived `early_ns` before others; true if the host's clock
/// was set.
bool SensorClock::observe(const Seen& packet, std::int64_t early_ns) {
  const std::int64_t offset_ns = packet.stamp.ns - packet_period_ns_ - line_ns_;
  if (fit_.empty()) {
    fit_.observe(line_ns_, offset_ns);
    return false;
  }
  const std::int64_t delay = offset_ns - fit_.offset_at(line_ns_);
  const std::int64_t step_ns = host_steps_.add(line_ns_, delay);
  if (step_ns < 0) {
    // Not followed: neither the IMU's time nor the published one goes back.
    host_shift_ns_ -= step_ns;
    fit_.observe(line_ns_, offset_ns - step_ns);
  } else if (step_ns > 0) {
    fit_.restart();
    fit_.observe(line_ns_, offset_ns);
    // The IMU's samples carry the host's time, from which the sensor's now differs.
    if (source_ == TimeSource::kAuto) in_step_ = false;
  } else if (delay > -early_ns) {
    fit_.observe(line_ns_, offset_ns);
  }
  if (step_ns != 0) host_steps_.restart();
  return step_ns != 0;
}

void SensorClock::on_gps_report(const GpsReport& report, core::Time stamp) {
  gps_ = report;
  gps_received_ = on_time_line(stamp);
}

std::optional<core::Time> SensorClock::time_of(std::uint32_t timestamp_us) const {
  if (!anchored_ || shift_free_) return std::nullopt;
  return to_time(line_ns_ + hour_difference_ns(timestamp_us, last_.timestamp_us));
}

core::Duration SensorClock::update_shift(std::int64_t scan_start_ns, std::int64_t scan_end_ns) {
  const std::int64_t wanted_ns = fitted() ? fit_.offset_at(scan_end_ns) : 0;
  core::Duration step;
  if (shift_free_) {
    shift_ns_ = has_clock_ ? wanted_ns : shift_ns_;
    shift_free_ = false;
  } else if (has_clock_) {
    const auto limit =
        static_cast<std::int64_t>(kSlew * static_cast<double>(scan_end_ns - shift_updated_ns_));
    const std::int64_t change_ns = wanted_ns - shift_ns_;
    // The host's clock was set forward: too far for slewing.
    if (change_ns > kClockSetNs) step.ns = change_ns;
    shift_ns_ += step.ns > 0 ? change_ns : std::clamp(change_ns, -limit, limit);
  }
  // After a backward jump, time continues from the last published one.
  if (emitted_ns_ != INT64_MIN) shift_ns_ = std::max(shift_ns_, emitted_ns_ + 1 - scan_start_ns);
  shift_updated_ns_ = scan_end_ns;
  emitted_ns_ = scan_end_ns + shift_ns_;
  return step;
}

core::ClockSource SensorClock::source() const {
  if (!has_clock_ || source_ == TimeSource::kHost) return core::ClockSource::kHost;
  const bool has_report = gps_ && std::abs((last_.stamp - gps_received_).ns) < kReportLifetimeNs;
  if (has_report && gps_->pulse_locked) return core::ClockSource::kPpsLocked;
  if (has_report && gps_->utc) return core::ClockSource::kNmeaOnly;
  if (!agrees_ || fitted()) return core::ClockSource::kFreeRunning;
  return has_ptp_ ? core::ClockSource::kPtp : core::ClockSource::kHostAgreement;
}

}  // namespace nilio::drivers
