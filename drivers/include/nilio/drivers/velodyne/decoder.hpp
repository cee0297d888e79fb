#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/velodyne/hdl64e/status.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include <cstdint>
#include <memory>
#include <optional>

namespace nilio::drivers {

enum class TimeSource {
  kAuto,    ///< sensor time where it agrees with the host's, otherwise sensor time fitted onto the host's
  kSensor,  ///< sensor time; its hour from GPS if available, otherwise from the host
  kHost,    ///< sensor time always fitted onto the host's clock; receive times when the sensor has no clock
};

/// Selects which of two returns become points.
enum class ReturnChoice { kAll, kStrongest, kLast };

struct ScanAssemblerConfig {
  TimeSource time_source = TimeSource::kAuto;
  /// Added to every firing's time, for firmware that stamps the end of a packet instead of its first firing.
  std::int64_t stamp_offset_ns = 0;
  /// Empty: detected from each packet.
  std::optional<ReturnMode> return_mode = std::nullopt;
  ReturnChoice returns = ReturnChoice::kAll;
  /// Azimuth at which one scan ends and the next begins, degrees in the sensor's own sense (0 = +y of the
  /// Velodyne frame = forward in the ROS frame, clockwise). 180 cuts behind the vehicle.
  double cut_azimuth_deg = 180.0;
  double min_range_m = 1.0;
  double max_range_m = 120.0;
  /// Smallest share of the field of view that a scan must surround (core::Scan::coverage_deg); other scans
  /// are dropped and counted (start, end, long loss).
  double min_coverage = 0.8;
  /// Additional room in the scans' buffers for points of other sources.
  std::size_t more_points = 0;
};

/// Upper limit of the points of a scan; buffers of this size never grow.
std::size_t scan_capacity(const VelodyneSensor& sensor);

/// Counts of a ScanAssembler. Every firing (shot of one laser) is in exactly one scan or counted here:
/// firings == firings_in_scans + firings_discarded + firings_bad + firings_late +
/// ScanAssembler::open_firings().
struct ScanAssemblerStats {
  std::uint64_t packets = 0;           ///< data packets, good or bad
  std::uint64_t position_packets = 0;  ///< telemetry
  std::uint64_t bad_length = 0;        ///< neither a data nor a position packet
  std::uint64_t duplicate_packets = 0;
  std::uint64_t late_packets = 0;    ///< out of order; their firings are in the open scan, or in firings_late
  std::uint64_t lost_packets = 0;    ///< gaps in the sensor's time stamps that no late packet filled
  std::uint64_t damaged_stamps = 0;  ///< packets whose time stamp no other packet agrees with
  std::uint64_t time_jumps = 0;      ///< the sensor's clock was set
  std::uint64_t host_clock_jumps = 0;
  std::uint64_t mode_changes = 0;  ///< the return mode changed
  std::uint64_t firings = 0;       ///< in all packets except duplicates
  std::uint64_t firings_in_scans = 0;
  std::uint64_t firings_discarded = 0;  ///< in scans that were dropped for too little coverage
  /// In blocks with a wrong flag, an azimuth out of range or out of line, and in packets with a damaged
  /// stamp.
  std::uint64_t firings_bad = 0;
  std::uint64_t firings_late = 0;  ///< of late packets whose scan was complete
  std::uint64_t scans = 0;
  std::uint64_t partial_scans = 0;  ///< dropped for too little coverage
  std::uint64_t points = 0;
  std::uint64_t points_out_of_range = 0;
};

/// State of the packet stream, for the user.
struct ScanAssemblerStatus {
  ReturnMode mode = ReturnMode::kSingle;
  /// Mean over one to two seconds.
  double revolutions_per_minute = 0.0;
  /// Current estimate of the time between packets.
  double packet_period_us = 0.0;
  /// Azimuth not covered in each revolution, degrees; 0 = full circle.
  double blind_sector_deg = 0.0;
  core::ClockSource clock_source = core::ClockSource::kHost;
  /// Offset added to the sensor's time, and its rate of change (parts per million).
  double clock_offset_s = 0.0;
  double clock_drift_ppm = 0.0;
};

/// Assembles packets into scans: decoding, timing and cutting at block level (docs/design/scan_cutting.md).
/// One thread. Does not allocate once the swapped-in scan objects have a scan's size.
class ScanAssembler {
 public:
  ScanAssembler(VelodyneSensor sensor, const ScanAssemblerConfig& config);
  ScanAssembler(ScanAssembler&&) noexcept;
  ScanAssembler& operator=(ScanAssembler&&) noexcept;
  ScanAssembler(const ScanAssembler&) = delete;
  ScanAssembler& operator=(const ScanAssembler&) = delete;
  ~ScanAssembler();

  /// Processes one data or position packet. Returns true when a scan became complete: take it with
  /// take_scan() before the next call. (A packet that contains the cut completes one scan and opens the
  /// next.)
  bool add(const Packet& packet);
  /// End of a recording: completes the open scan if it covers enough.
  bool finish();
  /// Swaps the completed scan with `scan`, whose buffer is reused.
  void take_scan(core::Scan& scan);

  [[nodiscard]] const ScanAssemblerStats& stats() const;
  [[nodiscard]] ScanAssemblerStatus status() const;
  /// Number of firings in the scan under assembly.
  [[nodiscard]] std::uint64_t open_firings() const;
  /// Status stream of an HDL-64E; null for other models.
  [[nodiscard]] const Hdl64eStatusReader* hdl64e_status() const;
  [[nodiscard]] const VelodyneSensor& sensor() const;
  /// Published time of a position packet's time stamp; empty before the first scan is complete, or without
  /// sensor clock.
  [[nodiscard]] std::optional<core::Time> time_of(std::uint32_t timestamp_us) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nilio::drivers
