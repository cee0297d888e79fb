#pragma once

#include "nilio/drivers/velodyne/decoder.hpp"

#include "drivers/velodyne/azimuth_coverage.hpp"
#include "drivers/velodyne/azimuth_steps.hpp"
#include "drivers/velodyne/blind_sector.hpp"
#include "drivers/velodyne/clock/sensor_clock.hpp"
#include "drivers/velodyne/firing_decoder.hpp"
#include "drivers/velodyne/scan_cutter.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace nilio::drivers {

/// Combines clock, cutter and decoder, and holds the scan under assembly.
class ScanAssembler::Impl {
 public:
  Impl(VelodyneSensor sensor, const ScanAssemblerConfig& config);

  bool add(const Packet& packet);
  bool finish();
  void take_scan(core::Scan& scan);
  [[nodiscard]] const ScanAssemblerStats& stats() const { return stats_; }
  [[nodiscard]] ScanAssemblerStatus status() const;
  [[nodiscard]] std::uint64_t open_firings() const { return open_firings_; }
  [[nodiscard]] const Hdl64eStatusReader* hdl64e_status() const {
    return has_status_stream_ ? &status_stream_ : nullptr;
  }
  [[nodiscard]] const VelodyneSensor& sensor() const { return sensor_; }
  [[nodiscard]] std::optional<core::Time> time_of(std::uint32_t timestamp_us) const {
    return clock_.time_of(timestamp_us);
  }

 private:
  /// The data packet being processed.
  struct Current {
    std::span<const std::uint8_t> payload;
    std::int64_t received_ns = 0;
    std::int64_t line_ns = 0;
    PacketAzimuths azimuths;
  };

  bool admit(const Packet& packet);
  PacketArrival arrive(const Packet& packet);
  void process(const Packet& packet, PacketArrival arrival);
  void discard_held();
  void follow_mode(std::span<const std::uint8_t> payload);
  void use_layout(std::size_t index);
  void on_position_packet(const Packet& packet);
  void on_status_byte(const PacketArrival& arrival, const Packet& packet);
  void measure_period(const PacketArrival& arrival);
  void account_gap(const PacketArrival& arrival, std::uint16_t first_azimuth);
  void add_in_order(Current& current);
  void add_late(Current& current);
  void add_step(const Current& current, std::size_t step);
  void decode_step(const Current& current, std::size_t step, std::int64_t step_ns);
  void prepare_scan();
  void close_scan();

  [[nodiscard]] std::int64_t step_time_ns(const Current& current, std::size_t step) const;
  [[nodiscard]] const PacketLayout& layout() const { return sensor_.layouts[layout_index_]; }
  [[nodiscard]] const FiringDecoder& decoder() const { return decoders_[layout_index_]; }
  [[nodiscard]] bool has_room() const;

  VelodyneSensor sensor_;
  ScanAssemblerConfig config_;
  ScanAssemblerStats stats_;
  std::size_t layout_index_ = 0;
  AzimuthTable azimuth_table_;
  std::vector<FiringDecoder> decoders_;
  SensorClock clock_;
  AzimuthReader azimuths_;
  ScanCutter cutter_;
  BlindSector blind_;
  AzimuthCoverage coverage_;
  bool has_status_stream_;
  Hdl64eStatusReader status_stream_;
  std::size_t capacity_;  ///< points of this sensor alone
  std::size_t buffer_capacity_;

  /// Measured, or nominal.
  double packet_period_ns_ = 0.0;
  std::int64_t azimuth_period_ns_ = 0;
  std::uint32_t periods_measured_ = 0;
  int other_mode_packets_ = 0;
  /// Azimuth rate and pause of the last packet in order.
  float rate_ = 0.0F;
  std::int64_t pause_ns_ = 0;

  /// Contradicts the time stamps before it; the next packet shows whether the clock was set or the stamp is
  /// damaged.
  Packet held_;
  bool is_holding_ = false;

  /// Points of one azimuth step.
  std::array<core::Point, (kBlocksPerPacket + 1) * kEntriesPerBlock> scratch_;
  core::Scan current_;
  core::Scan completed_;
  /// Replaces a buffer that is too small when take_scan() swaps it in.
  std::vector<core::Point> spare_;
  /// A scan became complete in the current packet.
  bool has_completed_ = false;
  bool after_time_jump_ = false;
  /// Time of the last firing of the scan under assembly, on the clock's time line.
  std::int64_t end_ns_ = 0;
  std::uint64_t open_firings_ = 0;
};

}  // namespace nilio::drivers
