#include "drivers/velodyne/clock/sensor_clock.hpp"

#include <algorithm>
#include <cstdlib>

namespace nilio::drivers {
namespace {

constexpr std::int64_t kHourUs = 3'600'000'000;
constexpr std::int64_t kHourNs = kHourUs * 1000;
constexpr std::int64_t kSecondNs = 1'000'000'000;
constexpr std::int64_t kReorderWindowNs = 50'000'000;
/// A larger difference between the steps of sensor and host clock means that one of them was set.
constexpr std::int64_t kClockSetNs = 500'000'000;
/// Largest step of the sensor's clock between packets; beyond it, the sensor's clock itself may have been
/// set.
constexpr std::int64_t kPlausibleStepNs = 2 * kSecondNs;
/// Within this difference sensor time counts as synchronised with the host's.
constexpr std::int64_t kSynchronisedNs = 200'000'000;
/// Largest rate at which the shift follows the fit.
constexpr double kSlew = 200e-6;
/// Validity of a GPS report; position packets arrive many times a second.
constexpr std::int64_t kReportLifetimeNs = 5 * kSecondNs;

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

PacketArrival SensorClock::arrive(std::uint32_t timestamp_us, std::uint16_t first_azimuth, core::Time stamp,
                                  std::int64_t previous_pause_ns) {
  if (!has_clock_) return arrive_without_clock(stamp);
  PacketArrival arrival;
  if (anchored_) {
    const std::int64_t step_ns = hour_difference_ns(timestamp_us, last_timestamp_us_);
    const std::int64_t host_step_ns = (stamp - last_stamp_).ns;
    if (step_ns <= 0 && step_ns > -kReorderWindowNs && std::abs(host_step_ns) < kClockSetNs)
      return out_of_order(timestamp_us, first_azimuth, step_ns);
    const bool disagree = std::abs(step_ns - host_step_ns) > kClockSetNs;
    arrival.host_jump =
        disagree && step_ns > 0 && step_ns < kPlausibleStepNs && std::abs(host_step_ns) < kHourNs / 2;
    if (step_ns <= 0 || (disagree && !arrival.host_jump) || is_wrong_hour(line_ns_ + step_ns, stamp)) {
      arrival.order = PacketOrder::kJump;
      return arrival;
    }
    line_ns_ += step_ns;
    arrival.since_previous_ns = step_ns;
    // The azimuth gives the pause to a few per cent.
    const std::int64_t unexplained_ns = step_ns - previous_pause_ns - previous_pause_ns / 20;
    const std::int64_t periods = (unexplained_ns + packet_period_ns_ / 2) / packet_period_ns_;
    arrival.gap_packets = static_cast<std::uint32_t>(std::max<std::int64_t>(periods - 1, 0));
    if (arrival.host_jump) fit_.restart();
    observe(stamp);
  } else {
    anchor(timestamp_us, stamp);
  }
  remember(timestamp_us, first_azimuth, stamp);
  arrival.line_ns = line_ns_;
  return arrival;
}

std::int64_t SensorClock::restart(std::uint32_t timestamp_us, std::uint16_t first_azimuth, core::Time stamp) {
  anchor(timestamp_us, stamp);
  remember(timestamp_us, first_azimuth, stamp);
  return line_ns_;
}

/// Smooths receive times minus a packet's duration: packets have an even rate.
PacketArrival SensorClock::arrive_without_clock(core::Time stamp) {
  constexpr std::int64_t kLockNs = 5'000'000;
  constexpr std::int64_t kSmoothing = 16;
  const std::int64_t observed_ns = stamp.ns - packet_period_ns_;
  PacketArrival arrival;
  if (!anchored_) {
    line_ns_ = observed_ns;
    anchored_ = true;
  } else {
    const std::int64_t predicted_ns = line_ns_ + packet_period_ns_;
    const std::int64_t error_ns = observed_ns - predicted_ns;
    const std::int64_t next_ns =
        std::abs(error_ns) < kLockNs ? predicted_ns + error_ns / kSmoothing : observed_ns;
    if (error_ns < -kClockSetNs || error_ns > kPlausibleStepNs) {
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

PacketArrival SensorClock::out_of_order(std::uint32_t timestamp_us, std::uint16_t azimuth,
                                        std::int64_t step_ns) const {
  PacketArrival arrival;
  arrival.order = PacketOrder::kLate;
  arrival.line_ns = line_ns_ + step_ns;
  for (std::size_t i = 0; i < std::min(seen_count_, kSeen); ++i) {
    if (seen_[i].timestamp_us == timestamp_us && seen_[i].azimuth == azimuth)
      arrival.order = PacketOrder::kDuplicate;
  }
  return arrival;
}

void SensorClock::remember(std::uint32_t timestamp_us, std::uint16_t azimuth, core::Time stamp) {
  seen_[seen_count_++ % kSeen] = {timestamp_us, azimuth};
  last_timestamp_us_ = timestamp_us;
  last_stamp_ = stamp;
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

void SensorClock::anchor(std::uint32_t timestamp_us, core::Time stamp) {
  const core::Time about = has_gps_hour(stamp) ? *gps_->utc : stamp;
  // Values slightly beyond one hour occur at the rollover.
  const std::int64_t past_hour_ns = static_cast<std::int64_t>(timestamp_us) % kHourUs * 1000;
  line_ns_ = past_hour_ns + floor_divide(about.ns - past_hour_ns + kHourNs / 2, kHourNs) * kHourNs;
  anchored_ = true;
  agrees_ = std::abs(line_ns_ - stamp.ns) < kSynchronisedNs;
  in_step_ = source_ == TimeSource::kSensor || (source_ == TimeSource::kAuto && agrees_);
  seen_count_ = 0;
  fit_.restart();
  shift_ns_ = 0;
  shift_free_ = true;
  observe(stamp);
}

void SensorClock::observe(core::Time stamp) {
  fit_.observe(line_ns_, stamp.ns - packet_period_ns_ - line_ns_);
}

void SensorClock::on_gps_report(const GpsReport& report, core::Time stamp) {
  gps_ = report;
  gps_received_ = stamp;
}

std::optional<core::Time> SensorClock::time_of(std::uint32_t timestamp_us) const {
  if (!anchored_ || shift_free_) return std::nullopt;
  return to_time(line_ns_ + hour_difference_ns(timestamp_us, last_timestamp_us_));
}

void SensorClock::update_shift(std::int64_t scan_start_ns, std::int64_t scan_end_ns) {
  const std::int64_t wanted_ns = fitted() ? fit_.offset_at(scan_end_ns) : 0;
  if (shift_free_) {
    shift_ns_ = has_clock_ ? wanted_ns : shift_ns_;
    shift_free_ = false;
  } else if (fitted()) {
    const auto limit =
        static_cast<std::int64_t>(kSlew * static_cast<double>(scan_end_ns - shift_updated_ns_));
    const std::int64_t change_ns = wanted_ns - shift_ns_;
    // The host's clock was set forward: too far for slewing.
    const bool step = change_ns > kClockSetNs;
    shift_ns_ += step ? change_ns : std::clamp(change_ns, -limit, limit);
  }
  // After a backward jump, time continues from the last published one.
  if (emitted_ns_ != INT64_MIN) shift_ns_ = std::max(shift_ns_, emitted_ns_ + 1 - scan_start_ns);
  shift_updated_ns_ = scan_end_ns;
  emitted_ns_ = scan_end_ns + shift_ns_;
}

core::ClockSource SensorClock::source() const {
  if (!has_clock_ || source_ == TimeSource::kHost) return core::ClockSource::kHost;
  const bool has_report = gps_ && std::abs((last_stamp_ - gps_received_).ns) < kReportLifetimeNs;
  if (has_report && gps_->pulse_locked) return core::ClockSource::kPpsLocked;
  if (has_report && gps_->utc) return core::ClockSource::kNmeaOnly;
  return agrees_ ? core::ClockSource::kPtp : core::ClockSource::kFreeRunning;
}

}  // namespace nilio::drivers
