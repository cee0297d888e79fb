#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"

#include "drivers/common/clock_fit.hpp"
#include "drivers/velodyne/clock/host_step.hpp"

#include <array>
#include <cstdint>
#include <optional>

namespace nilio::drivers {

/// The sensors' counter: microseconds past the hour.
inline constexpr std::int64_t kHourUs = 3'600'000'000;
/// A packet may arrive so much later than packets that were sent after it.
inline constexpr std::int64_t kReorderWindowNs = 50'000'000;

/// Difference of two counters modulo one hour, in (-30 min, 30 min].
constexpr std::int64_t hour_difference_ns(std::uint32_t now_us, std::uint32_t before_us) {
  std::int64_t difference =
      (static_cast<std::int64_t>(now_us) - static_cast<std::int64_t>(before_us)) % kHourUs;
  if (difference > kHourUs / 2) difference -= kHourUs;
  if (difference <= -kHourUs / 2) difference += kHourUs;
  return difference * 1000;
}

enum class PacketOrder {
  kNext,         ///< follows the previous packet, or is the first
  kDuplicate,    ///< a copy of a recent packet
  kLate,         ///< slightly older than the previous packet, and new
  kUnconfirmed,  ///< its stamp contradicts the previous packet's: keep it until the next packet decides
  kConfirmed,    ///< confirms the unconfirmed packet: process that one first, by its own result of confirm()
  kJump,         ///< the sensor's clock was set: restart() begins a new time line
};

struct PacketArrival {
  PacketOrder order = PacketOrder::kNext;
  /// The packet's stamp on the clock's time line; to_time() converts it to published time.
  std::int64_t line_ns = 0;
  /// Time since the previous packet's stamp; 0 for the first packet and after a jump.
  std::int64_t since_previous_ns = 0;
  /// Packets missing before this one, unless the time was spent in a blind sector.
  std::uint32_t gap_packets = 0;
  /// The unconfirmed packet had a damaged stamp: this packet does not agree with it.
  bool refutes = false;
  /// The host's clock was set less than a second ago.
  bool host_jump = false;
};

/// State of the sensor's time as its packets report it.
struct GpsReport {
  bool pulse_locked = false;
  /// UTC of a valid NMEA sentence.
  std::optional<core::Time> utc;
};

/// Converts the sensor's microseconds past the hour into a continuous time line, and fits that to the host's
/// clock.
///
/// The counter is continued by differences modulo one hour. The hour comes from GPS, or else from the host's
/// stamp of the first packet. Published time never goes back: it follows forward jumps of the sensor's clock,
/// and continues from its last value after a backward jump.
///
/// A packet can only arrive late. One that goes back by more than the reorder window, or arrives before it
/// can have been sent, has a damaged stamp unless the next packet agrees with it: then the sensor's clock was
/// set. While the sensor's stamps are regular, delays that stay beyond the usual ones show that the host's
/// clock was set. Time follows the host forward; when the host is set back, its stamps are shifted from then
/// on.
class SensorClock {
 public:
  SensorClock(TimeSource source, bool has_clock, bool has_ptp = false)
      : source_(source), has_clock_(has_clock), has_ptp_(has_ptp) {}

  /// Time between packets; may change from packet to packet.
  void set_packet_period(std::int64_t period_ns) { packet_period_ns_ = period_ns; }
  /// Processes a packet. `previous_pause_ns`: time of the previous packet beyond its period (a blind sector).
  /// `copy_key` tells the packets of a sensor without a clock apart.
  PacketArrival arrive(std::uint32_t timestamp_us, std::uint16_t first_azimuth, core::Time stamp,
                       std::int64_t previous_pause_ns, std::uint64_t copy_key = 0);
  /// After kConfirmed: processes the unconfirmed packet, as kNext or as kJump. Then call arrive() again for
  /// the packet that confirmed it.
  PacketArrival confirm(std::int64_t previous_pause_ns);
  /// Begins a new time line with a packet that arrived as kJump; returns its time on it.
  std::int64_t restart(std::uint32_t timestamp_us, std::uint16_t first_azimuth, core::Time stamp);
  /// Processes a report received at `stamp`.
  void on_gps_report(const GpsReport& report, core::Time stamp);
  /// Published time. The shift is constant until the next update_shift(), hence within a scan.
  [[nodiscard]] core::Time to_time(std::int64_t line_ns) const { return {line_ns + shift_ns_}; }
  /// Published time of another packet's stamp near the last one's; empty before update_shift() set the shift.
  [[nodiscard]] std::optional<core::Time> time_of(std::uint32_t timestamp_us) const;
  /// Call between two scans: follows the fit, slowly enough that time never goes back. Returns how far it
  /// followed a host's clock that was set ahead.
  core::Duration update_shift(std::int64_t scan_start_ns, std::int64_t scan_end_ns);

  [[nodiscard]] core::ClockSource source() const;
  [[nodiscard]] std::int64_t shift_ns() const { return shift_ns_; }
  [[nodiscard]] double drift() const { return fitted() ? fit_.drift() : 0.0; }

 private:
  /// A packet as the clock knows it; the host's stamp includes `host_shift_ns_`.
  struct Seen {
    std::uint32_t timestamp_us = 0;
    std::uint16_t azimuth = 0;
    core::Time stamp;
  };
  /// More packets than arrive within the reorder window.
  static constexpr std::size_t kSeen = 1024;

  PacketArrival arrive_without_clock(core::Time stamp, std::uint64_t copy_key);
  PacketArrival advance(const Seen& packet, std::int64_t previous_pause_ns);
  PacketArrival contradict(const Seen& packet);
  [[nodiscard]] bool was_seen(const Seen& packet) const;
  [[nodiscard]] bool follows(const Seen& packet, std::int64_t previous_pause_ns) const;
  [[nodiscard]] bool is_gap(const Seen& packet, std::int64_t early_ns) const;
  [[nodiscard]] std::int64_t delay_ns(const Seen& packet, std::int64_t line_ns) const;
  void remember(const Seen& packet);
  void anchor(const Seen& packet);
  bool observe(const Seen& packet, std::int64_t early_ns);
  [[nodiscard]] core::Time on_time_line(core::Time stamp) const { return {stamp.ns + host_shift_ns_}; }
  [[nodiscard]] bool has_gps_hour(core::Time stamp) const;
  [[nodiscard]] bool is_wrong_hour(std::int64_t line_ns, core::Time stamp) const;
  [[nodiscard]] bool fitted() const { return has_clock_ && !in_step_; }

  TimeSource source_;
  bool has_clock_;
  bool has_ptp_;
  std::int64_t packet_period_ns_ = 1;
  bool anchored_ = false;
  /// Sensor time is used unchanged: it is configured, or agrees with the host's.
  bool in_step_ = false;
  /// Sensor time agreed with the host's when it was anchored.
  bool agrees_ = false;
  std::array<Seen, kSeen> seen_{};
  std::array<std::uint64_t, kSeen> copy_keys_{};
  std::size_t seen_count_ = 0;
  Seen last_;
  std::optional<Seen> unconfirmed_;
  std::int64_t line_ns_ = 0;
  std::int64_t shift_ns_ = 0;
  /// The shift may change freely: no time was published since the last anchor.
  bool shift_free_ = true;
  std::int64_t shift_updated_ns_ = 0;
  /// Latest published time.
  std::int64_t emitted_ns_ = INT64_MIN;
  ClockFit fit_;
  HostStepDetector host_steps_;
  /// Sum of the steps by which the host's clock was set back.
  std::int64_t host_shift_ns_ = 0;
  std::optional<GpsReport> gps_;
  core::Time gps_received_;
};

}  // namespace nilio::drivers
