#include "tools/inspect/telemetry.hpp"

#include "nilio/core/units.hpp"

#include "tools/common/text.hpp"

#include <span>
#include <string_view>
#include <utility>

namespace nilio::tools::inspect {

namespace {

void add_motion(const std::array<drivers::Hdl32eBoard, 3>& boards, TelemetryFindings& findings) {
  if (!findings.motion) findings.motion.emplace();
  for (std::size_t i = 0; i < boards.size(); ++i) {
    BoardMotion& motion = (*findings.motion)[i];
    motion.gyro_deg_s.add(boards[i].gyro_rad_s * kDegreesPerRadian);
    motion.temperature_degc.add(boards[i].temperature_degc);
    motion.acceleration_x_m_s2.add(boards[i].acceleration_x_m_s2);
    motion.acceleration_y_m_s2.add(boards[i].acceleration_y_m_s2);
  }
}

}  // namespace

void TelemetryInspector::add(const drivers::Packet& packet) {
  const auto position = drivers::parse_position_packet(std::span(packet.data).first(packet.size));
  if (!position) return;
  if (findings_.packets++ == 0) {
    findings_.first = packet.stamp;
    findings_.port = packet.destination_port;
  }
  findings_.last = packet.stamp;
  ++findings_.pps[position->pps];
  findings_.last_pps = position->pps;
  add_nmea(*position, packet.stamp);
  const drivers::SensorHealth& health = position->health;
  if (health.top_board_degc != 0) findings_.top_board_degc.add(health.top_board_degc);
  if (health.bottom_board_degc != 0) findings_.bottom_board_degc.add(health.bottom_board_degc);
  findings_.thermal_shutdown = findings_.thermal_shutdown || health.thermal_status == 1;
  if (!position->motion) return;
  add_motion(*position->motion, findings_);
  imu_.add(*position->motion, packet.stamp);
  while (const auto sample = imu_.take()) samples_.add(*sample);
}

TelemetryFindings TelemetryInspector::finish() {
  if (findings_.motion) findings_.imu = samples_.finish();
  return std::move(findings_);
}

void TelemetryInspector::add_nmea(const drivers::PositionPacket& position, core::Time stamp) {
  const std::string_view text = position.nmea();
  if (text.empty()) {
    ++findings_.nmea_empty;
    return;
  }
  const std::optional<drivers::NmeaFix> fix = drivers::parse_nmea(text, stamp);
  if (fix && fix->valid) {
    ++findings_.nmea_valid;
    findings_.nmea_example = printable_text(text.substr(0, text.find_first_of("\r\n")));
    findings_.fix = fix;
    findings_.fix_stamp = stamp;
  } else if (fix) {
    ++findings_.nmea_no_fix;
    if (findings_.nmea_valid == 0)
      findings_.nmea_example = printable_text(text.substr(0, text.find_first_of("\r\n")));
  } else {
    ++findings_.nmea_unreadable;
    if (findings_.nmea_valid + findings_.nmea_no_fix == 0)
      findings_.nmea_example = printable_text(text.substr(0, text.find_first_of("\r\n")));
  }
}

const char* pps_name(drivers::PpsState state) {
  switch (state) {
    case drivers::PpsState::kAbsent:
      return "absent";
    case drivers::PpsState::kSynchronising:
      return "synchronising";
    case drivers::PpsState::kLocked:
      return "locked";
    case drivers::PpsState::kError:
      return "error";
    case drivers::PpsState::kUnknown:
      break;
  }
  return "not reported";
}

const char* gps_name(drivers::Hdl64eGps gps) {
  switch (gps) {
    case drivers::Hdl64eGps::kNone:
      return "none";
    case drivers::Hdl64eGps::kPulseAndTime:
      return "pulse and time";
    case drivers::Hdl64eGps::kTimeOnly:
      return "time only";
    case drivers::Hdl64eGps::kPulseOnly:
      return "pulse only";
    case drivers::Hdl64eGps::kUnknown:
      break;
  }
  return "unknown";
}

}  // namespace nilio::tools::inspect
