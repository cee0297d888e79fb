#include "daemon/output/event_log.hpp"
#include "daemon/output/run_reports.hpp"
#include "tools/common/text.hpp"
#include "tools/inspect/report/report.hpp"

#include <cmath>
#include <numbers>

#include <nlohmann/json.hpp>

namespace nilio::tools::inspect {

namespace {

using nlohmann::json;

json spread_json(const Spread& spread) {
  if (spread.empty()) return nullptr;
  return {{"count", spread.count()},
          {"mean", spread.mean()},
          {"std", spread.standard_deviation()},
          {"min", spread.minimum()},
          {"max", spread.maximum()}};
}

template <class Value>
json optional_json(const std::optional<Value>& value) {
  return value ? json(*value) : json(nullptr);
}

json axes_json(const std::array<Spread, 3>& axes) {
  return {spread_json(axes[0]), spread_json(axes[1]), spread_json(axes[2])};
}

json span_json(core::Time first, core::Time last) {
  return {{"first_ns", first.ns}, {"last_ns", last.ns}, {"seconds", (last - first).seconds()}};
}

json stream_json(const StreamFindings& stream) {
  return {{"sender", address_text(stream.address)},
          {"sender_port", stream.sender_port},
          {"port", stream.destination_port},
          {"content", stream.content == StreamContent::kData        ? "data"
                      : stream.content == StreamContent::kTelemetry ? "telemetry"
                                                                    : "other"},
          {"packets", stream.packets},
          {"bytes", stream.bytes},
          {"smallest", stream.smallest},
          {"largest", stream.largest}};
}

json clock_json(const SensorFindings& sensor) {
  json result = {{"source", nullptr}};
  if (sensor.clock_source) result["source"] = daemon::describe_clock(*sensor.clock_source);
  if (!sensor.clock) return result;
  result["offset_s"] = sensor.clock->offset_s;
  result["agrees"] = sensor.clock->agrees;
  result["drift_ppm"] = optional_json(sensor.clock->drift_ppm);
  return result;
}

json imu_json(const ImuFindings& imu) {
  return {{"preset", imu.preset},
          {"interface", imu.interface_name},
          {"plausible", imu.plausible()},
          {"samples", imu.stats.samples},
          {"incomplete", imu.stats.incomplete},
          {"short_frames", imu.stats.short_frames},
          {"out_of_order", imu.stats.out_of_order},
          {"rate_hz", imu.rate_hz()},
          {"interval_s", spread_json(imu.interval_s)},
          {"acceleration_m_s2", spread_json(imu.acceleration_m_s2)},
          {"linear_acceleration_m_s2", axes_json(imu.linear_acceleration)},
          {"angular_velocity_rad_s", axes_json(imu.angular_velocity)},
          {"still_seconds", imu.still_seconds},
          {"gyro_bias_rad_s", imu.still_seconds > 0 ? axes_json(imu.still_angular_velocity) : json(nullptr)},
          {"tilt_deg", optional_json(imu.tilt_deg())}};
}

json telemetry_json(const TelemetryFindings& telemetry) {
  json pps = json::object();
  for (const auto& [state, n] : telemetry.pps) pps[pps_name(state)] = n;
  json result = {{"packets", telemetry.packets},
                 {"port", telemetry.port},
                 {"pps", pps},
                 {"nmea",
                  {{"fix", telemetry.nmea_valid},
                   {"no_fix", telemetry.nmea_no_fix},
                   {"unreadable", telemetry.nmea_unreadable},
                   {"empty", telemetry.nmea_empty},
                   {"example", telemetry.nmea_example},
                   {"utc_ns", nullptr}}},
                 {"top_board_degc", spread_json(telemetry.top_board_degc)},
                 {"bottom_board_degc", spread_json(telemetry.bottom_board_degc)},
                 {"thermal_shutdown", telemetry.thermal_shutdown},
                 {"boards", nullptr},
                 {"imu", nullptr}};
  if (telemetry.fix && telemetry.fix->utc) result["nmea"]["utc_ns"] = telemetry.fix->utc->ns;
  if (!telemetry.motion) return result;
  result["boards"] = json::array();
  for (const BoardMotion& board : *telemetry.motion) {
    result["boards"].push_back({{"gyro_deg_s", spread_json(board.gyro_deg_s)},
                                {"temperature_degc", spread_json(board.temperature_degc)},
                                {"acceleration_x_m_s2", spread_json(board.acceleration_x_m_s2)},
                                {"acceleration_y_m_s2", spread_json(board.acceleration_y_m_s2)}});
  }
  if (telemetry.imu) result["imu"] = imu_json(*telemetry.imu);
  return result;
}

json hdl64e_json(const Hdl64eFindings& hdl64e) {
  json result = {{"cycles", hdl64e.counters.cycles},
                 {"tables", hdl64e.counters.tables},
                 {"gaps", hdl64e.counters.gaps},
                 {"wrong_crc", hdl64e.counters.wrong_crc},
                 {"implausible", hdl64e.counters.implausible},
                 {"calibration", hdl64e.calibration.has_value()},
                 {"checksum", nullptr},
                 {"firmware", nullptr},
                 {"gps", nullptr},
                 {"warnings", hdl64e.warnings},
                 {"temperature_degc", spread_json(hdl64e.temperature_degc)}};
  if (hdl64e.calibration) {
    const bool crc = hdl64e.calibration->checksum == drivers::Hdl64eChecksum::kCrc;
    result["checksum"] = crc ? "crc" : "none";
  }
  if (hdl64e.readings) {
    result["firmware"] = format("%u.%02u", hdl64e.readings->firmware >> 4, hdl64e.readings->firmware & 0x0FU);
    result["gps"] = gps_name(hdl64e.readings->gps);
  }
  return result;
}

json packets_json(const SensorFindings& sensor) {
  const drivers::ScanAssemblerStats& stats = sensor.stats;
  return {{"received", sensor.packets},
          {"per_second", sensor.packet_rate_hz()},
          {"lost", stats.lost_packets},
          {"duplicate", stats.duplicate_packets},
          {"late", stats.late_packets},
          {"bad_length", stats.bad_length},
          {"damaged_stamps", stats.damaged_stamps},
          {"firings", stats.firings},
          {"firings_bad", stats.firings_bad},
          {"time_jumps", stats.time_jumps},
          {"host_clock_jumps", stats.host_clock_jumps},
          {"mode_changes", stats.mode_changes},
          {"gaps", sensor.gaps},
          {"longest_pause_s", sensor.longest_pause_s}};
}

json sensor_json(const SensorFindings& sensor) {
  json result = {{"address", address_text(sensor.address)},
                 {"port", sensor.data_port},
                 {"model", nullptr},
                 {"model_certain", sensor.detection.model.has_value()},
                 {"candidates", json::array()},
                 {"evidence", sensor.detection.evidence},
                 {"hints", sensor.hints},
                 {"factory_bytes", nullptr},
                 {"return_mode", std::string(drivers::return_mode_name(sensor.status.mode))},
                 {"time", span_json(sensor.first, sensor.last)},
                 {"packets", packets_json(sensor)},
                 {"rpm", spread_json(sensor.revolutions_per_minute)},
                 {"blind_sector_deg", sensor.status.blind_sector_deg},
                 {"field_of_view_deg", nullptr},
                 {"scans", {{"complete", sensor.complete_scans}, {"partial", sensor.partial_scans}}},
                 {"points", sensor.stats.points},
                 {"points_per_scan", spread_json(sensor.points_per_scan)},
                 {"range_m", spread_json(sensor.range_m)},
                 {"clock", clock_json(sensor)},
                 {"hdl64e", sensor.hdl64e ? hdl64e_json(*sensor.hdl64e) : json(nullptr)},
                 {"telemetry", sensor.telemetry ? telemetry_json(*sensor.telemetry) : json(nullptr)}};
  if (sensor.model) result["model"] = std::string(drivers::velodyne_model_name(*sensor.model));
  for (const drivers::VelodyneModel model : sensor.detection.candidates)
    result["candidates"].push_back(std::string(drivers::velodyne_model_name(model)));
  if (sensor.factory) result["factory_bytes"] = {sensor.factory->mode, sensor.factory->product};
  if (sensor.field_of_view)
    result["field_of_view_deg"] = {sensor.field_of_view->start_deg, sensor.field_of_view->end_deg};
  return result;
}

json capture_json(const CaptureFindings& capture) {
  json result = {{"path", capture.path},
                 {"time", span_json(capture.first, capture.last)},
                 {"records", capture.records},
                 {"udp", capture.udp},
                 {"cut", capture.cut},
                 {"fragments", capture.fragments},
                 {"other_ip", capture.other_ip},
                 {"not_ipv4", capture.not_ipv4},
                 {"malformed", capture.malformed},
                 {"early_end", capture.early_end},
                 {"streams", json::array()},
                 {"further_stream_packets", capture.further_streams},
                 {"sensors", json::array()},
                 {"telemetry_without_data", json::object()}};
  for (const StreamFindings& stream : capture.streams) result["streams"].push_back(stream_json(stream));
  for (const SensorFindings& sensor : capture.sensors) result["sensors"].push_back(sensor_json(sensor));
  for (const auto& [address, telemetry] : capture.lone_telemetry)
    result["telemetry_without_data"][address_text(address)] = telemetry_json(telemetry);
  return result;
}

json message_json(const CanMessageFindings& message) {
  json result = {{"interface", message.interface_name},
                 {"id", message.id},
                 {"extended", message.extended},
                 {"name", message.name.empty() ? json(nullptr) : json(message.name)},
                 {"frames", message.frames},
                 {"shortest", message.shortest},
                 {"longest", message.longest},
                 {"rate_hz", message.rate_hz()},
                 {"interval_s", spread_json(message.interval_s)},
                 {"gaps", message.gaps},
                 {"signals", json::object()}};
  for (const CanSignalFindings& signal : message.signals)
    result["signals"][signal.name] = {{"unit", signal.unit}, {"physical", spread_json(signal.physical)}};
  return result;
}

json can_json(const CanFindings& can, const std::vector<CaptureFindings>& captures) {
  json result = {{"path", can.path},
                 {"time", span_json(can.first, can.last)},
                 {"frames", can.frames},
                 {"error_frames", can.error_frames},
                 {"remote_frames", can.remote_frames},
                 {"fd_frames", can.fd_frames},
                 {"broken_lines", can.broken_lines},
                 {"out_of_order", can.out_of_order},
                 {"interfaces", can.interfaces},
                 {"messages", json::array()},
                 {"further_frames", can.further_frames},
                 {"imus", json::array()},
                 {"captures", json::array()}};
  for (const CanMessageFindings& message : can.messages) result["messages"].push_back(message_json(message));
  for (const ImuFindings& imu : can.imus) result["imus"].push_back(imu_json(imu));
  for (const CaptureFindings& capture : captures) {
    if (!can.has_wall_clock()) break;
    const TimeRelation relation = relate(can, capture);
    result["captures"].push_back({{"path", capture.path},
                                  {"overlap_s", relation.overlap_s},
                                  {"start_offset_s", relation.start_offset_s},
                                  {"apart_s", relation.apart_s}});
  }
  return result;
}

json scale_json(const ScaleCorrection& scale) {
  return {{"known", scale.known}, {"factor", scale.factor}, {"sigma", scale.sigma}, {"unit", scale.is_unit}};
}

json drive_json(const DriveFindings& drive) {
  const ImuCalibration& c = drive.calibration;
  json result = {{"config", drive.config_path},
                 {"seconds", drive.seconds},
                 {"cut_short", drive.cut_short},
                 {"poses", drive.poses},
                 {"predicted", drive.predicted},
                 {"with_gyro", drive.with_gyro},
                 {"with_gyro_corrected", optional_json(drive.with_gyro_corrected)},
                 {"imu_samples", drive.imu_samples},
                 {"health", daemon::imu_health_json(drive.health)},
                 {"time_offset_ms", nullptr},
                 {"time_offset_sigma_ms", nullptr},
                 {"gyro_scale", scale_json(c.gyro)},
                 {"accel_scale", scale_json(c.accel)},
                 {"rotation_sigma_deg", json::array()},
                 {"mirror_known", c.mirror_known},
                 {"axes_disagree", c.axes_disagree},
                 {"correction", json::object()}};
  if (c.time_offset_known) {
    result["time_offset_ms"] = 1e3 * c.time_offset_s;
    result["time_offset_sigma_ms"] = 1e3 * c.time_offset_sigma_s;
  }
  for (const double sigma : c.rotation_sigma)
    result["rotation_sigma_deg"].push_back(std::isfinite(sigma) ? json(sigma * 180.0 / std::numbers::pi)
                                                                : json(nullptr));
  // Numbers and lists are the same in YAML and JSON.
  for (const CorrectedKey& key : corrected_keys(drive))
    result["correction"][key.path] = json::parse(key.value);
  return result;
}

}  // namespace

std::string inspect_json(const RecordingFindings& findings) {
  json result = {{"usable", findings.usable()},
                 {"problems", findings.problems},
                 {"captures", json::array()},
                 {"can_logs", json::array()}};
  result["imu_against_lidar"] = findings.drive ? drive_json(*findings.drive) : json(nullptr);
  result["imu_against_lidar_problem"] = findings.drive_problem;
  for (const CaptureFindings& capture : findings.captures)
    result["captures"].push_back(capture_json(capture));
  for (const CanFindings& can : findings.can_logs)
    result["can_logs"].push_back(can_json(can, findings.captures));
  for (const BagFindings& bag : findings.bags) {
    json topics = json::array();
    for (const drivers::BagTopicSurvey& topic : bag.survey.topics)
      topics.push_back({{"name", topic.topic.name},
                        {"type", topic.topic.type},
                        {"messages", topic.messages},
                        {"rate_hz", topic.rate_hz()}});
    result["bags"].push_back({{"files", bag.files},
                              {"topics", topics},
                              {"notes", bag.notes},
                              {"warnings", bag.warnings},
                              {"gnss", bag.gnss},
                              {"problem", bag.problem}});
  }
  // Paths and interface names may contain any bytes.
  return result.dump(2, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace nilio::tools::inspect
