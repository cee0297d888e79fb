#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"

#include "drivers/common/clock_fit.hpp"

#include <array>
#include <cstdint>
#include <optional>

namespace nilio::drivers {

enum class PacketOrder {
  kNext,       ///< follows the previous packet, or is the first
  kDuplicate,  ///< a copy of a recent packet
  kLate,       ///< slightly older than the previous packet, and new
  kJump,       ///< the sensor's clock was set: restart() begins a new time line
};

struct PacketArrival {
  PacketOrder order = PacketOrder::kNext;
  /// The packet's stamp on the clock's time line; to_time() converts it to published time.
  std::int64_t line_ns = 0;
  /// Time since the previous packet's stamp; 0 for the first packet and after a jump.
  std::int64_t since_previous_ns = 0;
  /// Packets missing before this one, unless the time was spent in a blind sector.
  std::uint32_t gap_packets = 0;
  /// The host's clock was set since the previous packet.
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
class SensorClock {
 public:
  SensorClock(TimeSource source, bool has_clock) : source_(source), has_clock_(has_clock) {}

  /// Time between packets; may change from packet to packet.
  void set_packet_period(std::int64_t period_ns) { packet_period_ns_ = period_ns; }
  /// Processes a packet. `previous_pause_ns`: time of the previous packet beyond its period (a blind sector).
  PacketArrival arrive(std::uint32_t timestamp_us, std::uint16_t first_azimuth, core::Time stamp,
                       std::int64_t previous_pause_ns);
  /// Begins a new time line with a packet that arrived as kJump; returns its time on it.
  std::int64_t restart(std::uint32_t timestamp_us, std::uint16_t first_azimuth, core::Time stamp);
  /// Processes a report received at `stamp`.
  void on_gps_report(const GpsReport& report, core::Time stamp);
  /// Published time. The shift is constant until the next update_shift(), hence within a scan.
  [[nodiscard]] core::Time to_time(std::int64_t line_ns) const { return {line_ns + shift_ns_}; }
  /// Published time of another packet's stamp near the last one's; empty before update_shift() set the shift.
  [[nodiscard]] std::optional<core::Time> time_of(std::uint32_t timestamp_us) const;
  /// Call between two scans: follows the fit, slowly enough that time never goes back.
  void update_shift(std::int64_t scan_start_ns, std::int64_t scan_end_ns);

  [[nodiscard]] core::ClockSource source() const;
  [[nodiscard]] std::int64_t shift_ns() const { return shift_ns_; }
  [[nodiscard]] double drift() const { return fitted() ? fit_.drift() : 0.0; }

 private:
  struct Seen {
    std::uint32_t timestamp_us = 0;
    std::uint16_t azimuth = 0;
  };
  /// More packets than arrive within the reorder window.
  static constexpr std::size_t kSeen = 1024;

  PacketArrival arrive_without_clock(core::Time stamp);
  PacketArrival out_of_order(std::uint32_t timestamp_us, std::uint16_t azimuth, std::int64_t step_ns) const;
  void remember(std::uint32_t timestamp_us, std::uint16_t azimuth, core::Time stamp);
  void anchor(std::uint32_t timestamp_us, core::Time stamp);
  void observe(core::Time stamp);
  [[nodiscard]] bool has_gps_hour(core::Time stamp) const;
  [[nodiscard]] bool is_wrong_hour(std::int64_t line_ns, core::Time stamp) const;
  [[nodiscard]] bool fitted() const { return has_clock_ && !in_step_; }

  TimeSource source_;
  bool has_clock_;
  std::int64_t packet_period_ns_ = 1;
  bool anchored_ = false;
  /// Sensor time is used unchanged: it is configured, or agrees with the host's.
  bool in_step_ = false;
  /// Sensor time agreed with the host's when it was anchored.
  bool agrees_ = false;
  std::array<Seen, kSeen> seen_{};
  std::size_t seen_count_ = 0;
  std::uint32_t last_timestamp_us_ = 0;
  core::Time last_stamp_;
  std::int64_t line_ns_ = 0;
  std::int64_t shift_ns_ = 0;
  /// The shift may change freely: no time was published since the last anchor.
  bool shift_free_ = true;
  std::int64_t shift_updated_ns_ = 0;
  /// Latest published time.
  std::int64_t emitted_ns_ = INT64_MIN;
  ClockFit fit_;
  std::optional<GpsReport> gps_;
  core::Time gps_received_;
};

}  // namespace nilio::drivers
