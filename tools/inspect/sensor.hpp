#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"
#include "nilio/drivers/velodyne/detect.hpp"

#include "tools/common/statistics.hpp"
#include "tools/inspect/clock.hpp"
#include "tools/inspect/telemetry.hpp"

#include <array>
#include <bitset>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::inspect {

struct FactoryBytes {
  std::uint8_t mode = 0;
  std::uint8_t product = 0;
};

/// Field of view of a sensor: clockwise from `start_deg` to `end_deg`.
struct FieldOfView {
  int start_deg = 0;
  int end_deg = 360;
};

/// One sensor of a capture. Numbers of scans are those of niliod's decoder, with all ranges accepted.
struct SensorFindings {
  std::uint32_t address = 0;
  std::uint16_t data_port = 0;
  drivers::VelodyneDetection detection;
  /// Model that the packets were decoded as; unset for an unknown model.
  std::optional<drivers::VelodyneModel> model;
  /// Of the first packet; unset for an HDL-64E, which has its status stream there.
  std::optional<FactoryBytes> factory;
  /// Irregularities of the sensor or its firmware, one line each.
  std::vector<std::string> hints;
  core::Time first;
  core::Time last;
  std::uint64_t packets = 0;
  drivers::ScanAssemblerStats stats;
  drivers::ScanAssemblerStatus status;
  std::optional<FieldOfView> field_of_view;
  std::uint64_t complete_scans = 0;
  std::uint64_t partial_scans = 0;
  /// Of complete scans.
  Spread points_per_scan;
  Spread revolutions_per_minute;
  Spread range_m;
  /// By capture stamps; gaps are pauses longer than a revolution at minimum speed.
  double longest_pause_s = 0.0;
  std::uint64_t gaps = 0;
  std::optional<ClockFindings> clock;
  /// Time source of the last scan.
  std::optional<core::ClockSource> clock_source;
  std::optional<Hdl64eFindings> hdl64e;
  std::optional<TelemetryFindings> telemetry;

  [[nodiscard]] double duration_s() const { return (last - first).seconds(); }
  /// 0 for a single packet.
  [[nodiscard]] double packet_rate_hz() const;
  [[nodiscard]] bool usable() const { return model.has_value() && stats.points > 0; }
};

/// Decodes the packets of one sensor; buffers the first ones until the model is identified, then one scan.
/// One thread.
class SensorInspector {
 public:
  SensorInspector(std::uint32_t address, std::uint16_t data_port);

  /// A data packet, or one of the same stream with another size.
  void add_data(const drivers::Packet& packet);
  void add_telemetry(const drivers::Packet& packet);
  /// At the end of the capture, once.
  SensorFindings finish();

 private:
  void start();
  void decode(const drivers::Packet& packet);
  void take_scan();
  void note_time(const drivers::Packet& packet);
  void note_azimuths(const drivers::Packet& packet);
  void add_status(const drivers::Packet& packet);
  void add_hints();

  SensorFindings findings_;
  /// Until the model is known.
  std::vector<drivers::Packet> head_;
  bool started_ = false;
  std::optional<drivers::ScanAssembler> assembler_;
  core::Scan scan_;
  std::optional<core::Time> last_complete_start_;
  ClockComparison clock_;
  std::optional<drivers::Hdl64eStatusReader> status_reader_;
  std::uint64_t lost_seen_ = 0;
  std::bitset<360> azimuths_;
};

/// "192.168.1.201".
std::string address_text(std::uint32_t address);

}  // namespace nilio::tools::inspect
