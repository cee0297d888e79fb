#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/velodyne/clock/nmea.hpp"
#include "nilio/drivers/velodyne/clock/position_packet.hpp"
#include "nilio/drivers/velodyne/hdl64e/status.hpp"

#include "tools/common/statistics.hpp"

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace nilio::tools::inspect {

/// One board of an HDL-32E.
struct BoardMotion {
  Spread gyro_deg_s;
  Spread temperature_degc;
  Spread acceleration_x_m_s2;
  Spread acceleration_y_m_s2;
};

/// What the telemetry packets of one sender say.
struct TelemetryFindings {
  std::uint64_t packets = 0;
  std::uint16_t port = 0;
  core::Time first;
  core::Time last;
  std::map<drivers::PpsState, std::uint64_t> pps;
  drivers::PpsState last_pps = drivers::PpsState::kUnknown;
  /// Packets with a sentence that holds a fix, one without, one that cannot be read, and none at all.
  std::uint64_t nmea_valid = 0;
  std::uint64_t nmea_no_fix = 0;
  std::uint64_t nmea_unreadable = 0;
  std::uint64_t nmea_empty = 0;
  /// The latest of the best kind seen, printable characters only.
  std::string nmea_example;
  /// Of the latest valid sentence, and the capture's stamp of its packet.
  std::optional<drivers::NmeaFix> fix;
  core::Time fix_stamp;
  /// Firmware that reports no temperatures sends zeros, which are left out.
  Spread top_board_degc;
  Spread bottom_board_degc;
  bool thermal_shutdown = false;
  /// HDL-32E only.
  std::optional<std::array<BoardMotion, 3>> motion;
};

/// Takes the telemetry packets of one sender. One thread.
class TelemetryInspector {
 public:
  /// Does nothing with packets that are not of 512 bytes.
  void add(const drivers::Packet& packet);
  [[nodiscard]] const TelemetryFindings& findings() const { return findings_; }

 private:
  void add_nmea(const drivers::PositionPacket& position, core::Time stamp);

  TelemetryFindings findings_;
};

/// What the status stream of an HDL-64E says.
struct Hdl64eFindings {
  drivers::Hdl64eStatusCounters counters;
  std::optional<drivers::Hdl64eReadings> readings;
  std::optional<drivers::Hdl64eCalibration> calibration;
  /// Every warning bit that was ever set.
  std::uint8_t warnings = 0;
  Spread temperature_degc;
};

/// For people: "locked", "absent", ...
const char* pps_name(drivers::PpsState state);
const char* gps_name(drivers::Hdl64eGps gps);

}  // namespace nilio::tools::inspect
