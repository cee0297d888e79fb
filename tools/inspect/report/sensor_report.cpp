#include "daemon/output/event_log.hpp"
#include "tools/common/text.hpp"
#include "tools/inspect/report/report.hpp"

#include <cmath>

namespace nilio::tools::inspect {

namespace {

unsigned long long count(std::uint64_t n) { return n; }

std::string row(const char* name, const std::string& value) {
  return format("    %-14s %s\n", name, value.c_str());
}

std::string spread_text(const Spread& spread, int digits, const char* unit) {
  if (spread.empty()) return "unknown";
  if (spread.maximum() - spread.minimum() < 0.5 * std::pow(10.0, -digits))
    return format("%.*f %s", digits, spread.mean(), unit);
  return format("%.*f %s (%.*f to %.*f)", digits, spread.mean(), unit, digits, spread.minimum(), digits,
                spread.maximum());
}

std::string model_text(const SensorFindings& sensor) {
  std::string text = std::string(drivers::velodyne_model_name(*sensor.model));
  std::string others;
  for (const drivers::VelodyneModel model : sensor.detection.candidates) {
    if (model != *sensor.model)
      others += (others.empty() ? "" : ", ") + std::string(drivers::velodyne_model_name(model));
  }
  if (others.empty()) return text;
  return text + (sensor.detection.model ? " (packets of " + others + " are alike)"
                                        : " or " + others + ": not distinguishable by the packets");
}

std::string loss_text(const drivers::ScanAssemblerStats& stats) {
  const std::uint64_t sent = stats.packets + stats.lost_packets;
  const double share =
      sent > 0 ? 100.0 * static_cast<double>(stats.lost_packets) / static_cast<double>(sent) : 0.0;
  std::string text = stats.lost_packets == 0
                         ? std::string("none lost")
                         : format("%llu lost (%.3f %%)", count(stats.lost_packets), share);
  const auto add = [&](std::uint64_t n, const char* what) {
    if (n > 0) text += format(", %llu %s", count(n), what);
  };
  add(stats.duplicate_packets, "duplicate");
  add(stats.late_packets, "late");
  add(stats.bad_length, "of wrong length");
  add(stats.damaged_stamps, "with damaged stamps");
  add(stats.firings_bad, "firings damaged");
  return text;
}

/// Empty without irregularities.
std::string jumps_text(const SensorFindings& sensor) {
  std::string text;
  const auto add = [&](std::uint64_t n, const char* what) {
    if (n > 0) text += format("%s%s %llu x", text.empty() ? "" : ", ", what, count(n));
  };
  add(sensor.stats.time_jumps, "the sensor's clock was set");
  add(sensor.stats.host_clock_jumps, "the recorder's clock was set");
  add(sensor.stats.mode_changes, "the return mode changed");
  if (sensor.gaps > 0)
    text += format("%s%llu gaps, the longest of %s", text.empty() ? "" : ", ", count(sensor.gaps),
                   span_text(sensor.longest_pause_s).c_str());
  return text;
}

std::string scan_rows(const SensorFindings& sensor) {
  std::string text;
  text += row("speed", spread_text(sensor.revolutions_per_minute, 1, "rpm"));
  if (sensor.field_of_view) {
    text +=
        row("field of view", format("%.0f deg, from %d to %d deg clockwise; %.0f deg blind",
                                    360.0 - sensor.status.blind_sector_deg, sensor.field_of_view->start_deg,
                                    sensor.field_of_view->end_deg, sensor.status.blind_sector_deg));
  } else {
    text += row("field of view", sensor.complete_scans > 0 ? "360 deg" : "unknown");
  }
  text += row("scans", format("%llu complete, %llu partial", count(sensor.complete_scans),
                              count(sensor.partial_scans)));
  if (sensor.points_per_scan.empty()) {
    text += row("points", format("%llu, no complete scan", count(sensor.stats.points)));
  } else {
    text += row("points", format("%llu, %s", count(sensor.stats.points),
                                 spread_text(sensor.points_per_scan, 0, "a scan").c_str()));
  }
  const double firings = static_cast<double>(sensor.stats.firings);
  text += row("returns", format("%.3f a firing, at %.2f to %.2f m",
                                firings > 0.0 ? static_cast<double>(sensor.stats.points) / firings : 0.0,
                                sensor.range_m.minimum(), sensor.range_m.maximum()));
  return text;
}

std::string clock_rows(const SensorFindings& sensor) {
  if (!sensor.clock) return row("time", "the sensor has no clock; receive times are used");
  std::string text;
  const ClockFindings& clock = *sensor.clock;
  text += row("time", format("%s; %s the capture's (%s, modulo 1 h)",
                             sensor.clock_source ? daemon::describe_clock(*sensor.clock_source) : "unknown",
                             clock.agrees ? "agrees with" : "differs from",
                             ((clock.offset_s >= 0.0 ? "+" : "") + span_text(clock.offset_s)).c_str()));
  if (clock.drift_ppm)
    text += row("drift", format("%+.1f ppm against the capture's stamps", *clock.drift_ppm));
  return text;
}

std::string nmea_text(const TelemetryFindings& telemetry) {
  std::string text = format("%llu with a fix", count(telemetry.nmea_valid));
  const auto add = [&](std::uint64_t n, const char* what) {
    if (n > 0) text += format(", %llu %s", count(n), what);
  };
  add(telemetry.nmea_no_fix, "without a fix");
  add(telemetry.nmea_unreadable, "unreadable");
  add(telemetry.nmea_empty, "packets without a sentence");
  return telemetry.nmea_valid + telemetry.nmea_no_fix + telemetry.nmea_unreadable == 0 ? "no sentences"
                                                                                       : text;
}

/// A sentence describes the preceding second, so that a delay is normal.
std::string fix_text(const TelemetryFindings& telemetry) {
  const double behind_s = (telemetry.fix_stamp - *telemetry.fix->utc).seconds();
  return format("UTC %s, %s %s the capture's stamp", utc_text(*telemetry.fix->utc).c_str(),
                span_text(std::abs(behind_s)).c_str(), behind_s >= 0.0 ? "before" : "after");
}

std::string telemetry_rows(const TelemetryFindings& telemetry) {
  const double seconds = (telemetry.last - telemetry.first).seconds();
  const double rate = seconds > 0.0 ? static_cast<double>(telemetry.packets - 1) / seconds : 0.0;
  std::string text = row("telemetry", format("%llu packets, %.1f /s, to port %u", count(telemetry.packets),
                                             rate, telemetry.port));
  std::string pps;
  for (const auto& [state, n] : telemetry.pps) {
    pps += (pps.empty() ? "" : ", ") + std::string(pps_name(state));
    if (telemetry.pps.size() > 1) pps += format(" %llu x", count(n));
  }
  text += row("PPS", pps);
  text += row("NMEA", nmea_text(telemetry));
  if (!telemetry.nmea_example.empty()) text += row("", telemetry.nmea_example);
  if (telemetry.fix && telemetry.fix->utc) text += row("", fix_text(telemetry));
  if (!telemetry.top_board_degc.empty())
    text += row("top board", spread_text(telemetry.top_board_degc, 0, "degC"));
  if (!telemetry.bottom_board_degc.empty())
    text += row("bottom board", spread_text(telemetry.bottom_board_degc, 0, "degC"));
  if (telemetry.thermal_shutdown) text += row("heat", "the sensor reported a thermal shutdown");
  if (!telemetry.motion) return text;
  text += format("    %-14s %18s %14s %20s %20s\n", "boards", "gyro deg/s", "temp. degC", "acc. x m/s^2",
                 "acc. y m/s^2");
  const auto cell = [](const Spread& spread, int digits) {
    return format("%.*f +- %.*f", digits, spread.mean(), digits, spread.standard_deviation());
  };
  for (std::size_t i = 0; i < telemetry.motion->size(); ++i) {
    const BoardMotion& board = (*telemetry.motion)[i];
    text += format("    %-14zu %18s %14.1f %20s %20s\n", i, cell(board.gyro_deg_s, 2).c_str(),
                   board.temperature_degc.mean(), cell(board.acceleration_x_m_s2, 3).c_str(),
                   cell(board.acceleration_y_m_s2, 3).c_str());
  }
  if (telemetry.imu) text += imu_report(*telemetry.imu);
  return text;
}

std::string hdl64e_rows(const Hdl64eFindings& hdl64e) {
  if (!hdl64e.readings) return row("status", "no complete cycle in the status bytes");
  const drivers::Hdl64eReadings& readings = *hdl64e.readings;
  std::string text = row("firmware", format("%u.%02u", readings.firmware >> 4, readings.firmware & 0x0FU));
  text += row("temperature", spread_text(hdl64e.temperature_degc, 0, "degC"));
  text += row("GPS", gps_name(readings.gps));
  if (readings.clock) text += row("clock", utc_text(*readings.clock) + " by the status stream");
  std::string warnings;
  const auto warn = [&](std::uint8_t bit, const char* what) {
    if ((hdl64e.warnings & bit) != 0) warnings += (warnings.empty() ? "" : ", ") + std::string(what);
  };
  warn(drivers::kHdl64eLensDirty, "lens dirty");
  warn(drivers::kHdl64eTooHot, "too hot");
  warn(drivers::kHdl64eTooCold, "too cold");
  if (!warnings.empty()) text += row("warnings", warnings);
  const drivers::Hdl64eStatusCounters& counters = hdl64e.counters;
  if (hdl64e.calibration) {
    const bool crc = hdl64e.calibration->checksum == drivers::Hdl64eChecksum::kCrc;
    text +=
        row("calibration", format("complete in the status stream, %llu x, %s; --write-calibration saves it",
                                  count(counters.tables), crc ? "CRC right" : "no CRC (S2 firmware)"));
  } else if (counters.cycles >= 2 * drivers::kHdl64eStatusCycles && counters.gaps == 0 &&
             counters.wrong_crc + counters.implausible == 0) {
    text += row("calibration", "none in the status stream");
  } else {
    text += row(
        "calibration",
        format("incomplete in the status stream (%llu cycles, %zu make one; %llu gaps, %llu wrong CRC, %llu "
               "implausible)",
               count(counters.cycles), drivers::kHdl64eStatusCycles, count(counters.gaps),
               count(counters.wrong_crc), count(counters.implausible)));
  }
  return text;
}

}  // namespace

std::string return_mode_text(const SensorFindings& sensor) {
  std::string text(drivers::return_mode_name(sensor.status.mode));
  if (sensor.factory && sensor.status.mode == drivers::ReturnMode::kSingle) {
    if (sensor.factory->mode == 0x37) text += " (strongest)";
    if (sensor.factory->mode == 0x38) text += " (last)";
  }
  return text;
}

std::string sensor_report(const SensorFindings& sensor) {
  std::string text =
      format("  Sensor %s, data to port %u\n", address_text(sensor.address).c_str(), sensor.data_port);
  if (!sensor.model) {
    text += row("model", "unknown");
    return text + row("evidence", sensor.detection.evidence);
  }
  text += row("model", model_text(sensor));
  text += row("evidence", sensor.detection.evidence);
  for (const std::string& hint : sensor.hints) text += row("note", hint);
  text += row("return mode", return_mode_text(sensor));
  text += row("packets", format("%llu, %.1f /s, %s; %s", count(sensor.packets), sensor.packet_rate_hz(),
                                span_text(sensor.duration_s()).c_str(), loss_text(sensor.stats).c_str()));
  const std::string jumps = jumps_text(sensor);
  if (!jumps.empty()) text += row("irregular", jumps);
  text += scan_rows(sensor) + clock_rows(sensor);
  if (sensor.hdl64e) text += hdl64e_rows(*sensor.hdl64e);
  return text + (sensor.telemetry ? telemetry_rows(*sensor.telemetry) : row("telemetry", "none"));
}

}  // namespace nilio::tools::inspect
