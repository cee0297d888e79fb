#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/imu/hdl32e_imu.hpp"
#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/velodyne/clock/nmea.hpp"
#include "nilio/drivers/velodyne/clock/position_packet.hpp"
#include "nilio/drivers/velodyne/hdl64e/status.hpp"

#include "tools/common/statistics.hpp"
#include "tools/inspect/imu.hpp"

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

/// Contents of the telemetry packets of one sender.
struct TelemetryFindings {
  std::uint64_t packets = 0;
  std::uint16_t port = 0;
  core::Time first;
  core::Time last;
  std::map<drivers::PpsState, std::uint64_t> pps;
  drivers::PpsState last_pps = drivers::PpsState::kUnknown;
  /// Packets with a sentence with fix, without fix, unreadable, and without a sentence.
  std::uint64_t nmea_valid = 0;
  std::uint64_t nmea_no_fix = 0;
  std::uint64_t nmea_unreadable = 0;
  std::uint64_t nmea_empty = 0;
  /// The latest sentence of the best kind, printable characters only.
  std::string nmea_example;
  /// Of the latest valid sentence, with the capture's stamp of its packet.
  std::optional<drivers::NmeaFix> fix;
  core::Time fix_stamp;
  /// Zeros of firmware without temperatures are excluded.
  Spread top_board_degc;
  Spread bottom_board_degc;
  bool thermal_shutdown = false;
  /// HDL-32E only.
  std::optional<std::array<BoardMotion, 3>> motion;
  /// Its motion in the LiDAR's axes.
  std::optional<ImuFindings> imu;
};

/// Parses the telemetry packets of one sensor. One thread.
class TelemetryInspector {
 public:
  /// Ignores packets of other sizes than 512 bytes.
  void add(const drivers::Packet& packet);
  /// At the end of the capture, once.
  TelemetryFindings finish();

 private:
  void add_nmea(const drivers::PositionPacket& position, core::Time stamp);

  TelemetryFindings findings_;
  drivers::Hdl32eImu imu_;
  ImuInspector samples_ = ImuInspector::of_hdl32e();
};

/// Contents of the status stream of an HDL-64E.
struct Hdl64eFindings {
  drivers::Hdl64eStatusCounters counters;
  std::optional<drivers::Hdl64eReadings> readings;
  std::optional<drivers::Hdl64eCalibration> calibration;
  /// Union of all warning bits.
  std::uint8_t warnings = 0;
  Spread temperature_degc;
};

/// For people: "locked", "absent", ...
const char* pps_name(drivers::PpsState state);
const char* gps_name(drivers::Hdl64eGps gps);

}  // namespace nilio::tools::inspect
