#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/velodyne_model.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace nilio::drivers {

enum class TimeSource {
  kAuto,    ///< sensor time where it agrees with the host's, else sensor time shifted onto the host's
  kSensor,  ///< sensor time, hour resolved by the host's
  kHost,    ///< receive time less the packet's duration
};

struct ScanAssemblerConfig {
  TimeSource time_source = TimeSource::kAuto;
  /// Azimuth at which one scan ends and the next begins, degrees in the sensor's own sense (0 = +y of the
  /// Velodyne frame = forward in the ROS frame, clockwise). 180 cuts behind the vehicle.
  double cut_azimuth_deg = 180.0;
  double min_range_m = 1.0;
  double max_range_m = 120.0;
  /// A scan covering less than this is dropped and counted (start, end, long loss).
  double min_coverage_deg = 300.0;
};

/// Every firing is in exactly one scan or counted here.
struct ScanAssemblerStats {
  std::uint64_t packets = 0;     ///< data packets, good or bad; position packets are passed over
  std::uint64_t bad_length = 0;  ///< neither a data nor a position packet
  std::uint64_t bad_block = 0;   ///< blocks with a wrong flag, or an azimuth out of range or out of line
  std::uint64_t dual_return =
      0;  ///< packets of a sensor set to dual return: not decoded, set it to strongest
  std::uint64_t duplicate_packets = 0;
  std::uint64_t reordered_packets = 0;  ///< older than the previous by less than 50 ms: dropped
  std::uint64_t lost_packets = 0;       ///< gaps in the sensor's time stamps
  std::uint64_t time_jumps = 0;
  std::uint64_t scans = 0;
  std::uint64_t partial_scans = 0;  ///< dropped for too little coverage
  std::uint64_t points = 0;
  std::uint64_t points_out_of_range = 0;
};

/// Turns packets into scans: decodes, times and cuts at block level. One thread. No allocation once the scan
/// objects that are swapped in have grown to a scan's size.
class ScanAssembler {
 public:
  ScanAssembler(VelodyneSensor sensor, const ScanAssemblerConfig& config);
  ScanAssembler(ScanAssembler&&) noexcept;
  ScanAssembler& operator=(ScanAssembler&&) noexcept;
  ScanAssembler(const ScanAssembler&) = delete;
  ScanAssembler& operator=(const ScanAssembler&) = delete;
  ~ScanAssembler();

  /// Feeds one packet. Returns true when a scan became complete: take it with take_scan() before the next
  /// call. (A packet that holds the cut completes one scan and opens the next.)
  bool add(const Packet& packet);
  /// At the end of a recording: completes what is there, if it covers enough.
  bool finish();
  /// Swaps the completed scan with `scan`, whose buffer is reused for a scan to come.
  void take_scan(core::Scan& scan);

  [[nodiscard]] const ScanAssemblerStats& stats() const { return stats_; }
  [[nodiscard]] const VelodyneSensor& sensor() const { return sensor_; }

 private:
  /// Clock, tables and the scan under assembly.
  struct State;

  bool admit(const Packet& packet);
  void add_step(const Packet& packet, std::size_t step, std::int64_t step_time_ns);
  void track_azimuth(std::uint16_t azimuth, std::int64_t time_ns, float rate);
  [[nodiscard]] bool must_cut(std::int64_t time_ns) const;
  void open_scan(std::int64_t time_ns);
  void close_scan();

  VelodyneSensor sensor_;
  ScanAssemblerConfig config_;
  ScanAssemblerStats stats_;
  std::unique_ptr<State> state_;
};

/// Guesses the model from the factory bytes and the packets' shape; nothing when the packets do not say.
std::optional<VelodyneModel> detect_velodyne_model(std::span<const Packet> packets);

}  // namespace nilio::drivers
