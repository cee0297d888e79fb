#include "inspect_config.hpp"

#include "nilio/daemon/config.hpp"

#include "inspect_report.hpp"
#include "inspect_text.hpp"

#include <cmath>

namespace nilio::tools {

namespace {

using core::Error;
using core::Result;

/// Beyond it niliod does not take a sensor's time for synchronised with the recorder's.
constexpr double kClockWrongS = 0.2;
/// Nobody sets a sensor more often in a recording: then single packets are misread, as where nothing returns.
constexpr std::uint64_t kMostRealModeChanges = 5;

/// On one line and with nothing in it that YAML would read.
std::string comment_text(const std::string& text) {
  std::string result;
  for (const char c : text) result.push_back(static_cast<unsigned char>(c) < ' ' ? '?' : c);
  return result;
}

std::string quoted(const std::string& value) {
  std::string result = "\"";
  for (const char c : value) {
    if (c == '"' || c == '\\') result.push_back('\\');
    result += static_cast<unsigned char>(c) < ' ' ? format("\\x%02X", static_cast<unsigned char>(c))
                                                  : std::string(1, c);
  }
  return result + "\"";
}

class Section {
 public:
  explicit Section(const char* name) : name_(name) {}
  void add(const std::string& key, const std::string& value, const std::string& why) {
    lines_ += "  # " + comment_text(why) + "\n  " + key + ": " + value + "\n";
  }
  void note(const std::string& text) { notes_ += "  # " + comment_text(text) + "\n"; }
  /// Empty without keys, but for the notes.
  [[nodiscard]] std::string text() const {
    return lines_.empty() ? (notes_.empty() ? "" : "# " + name_ + ":\n" + notes_)
                          : name_ + ":\n" + lines_ + notes_;
  }

 private:
  std::string name_;
  std::string lines_;
  std::string notes_;
};

void add_model(const SensorFindings& sensor, Section& section) {
  std::string why = sensor.detection.evidence;
  std::string others;
  for (const drivers::VelodyneModel model : sensor.detection.candidates) {
    if (model != *sensor.model)
      others += (others.empty() ? "" : " or ") + std::string(drivers::velodyne_model_name(model));
  }
  if (!others.empty()) why += "; if the label says " + others + ", set that";
  section.add("model", quoted(std::string(drivers::velodyne_model_name(*sensor.model))), why);
  for (const std::string& hint : sensor.hints) section.note(hint);
}

void add_calibration(const SensorFindings& sensor, const std::string& path, Section& section) {
  if (!sensor.hdl64e) return;
  if (!path.empty()) {
    section.add("calibration", quoted(path), "the unit's own, from its status stream");
  } else if (sensor.hdl64e->calibration) {
    section.note("every HDL-64E has a geometry of its own: run nilio inspect with --write-calibration too");
  } else {
    section.note(
        "every HDL-64E has a geometry of its own, and the status stream here is not whole: set calibration "
        "to "
        "the unit's db.xml");
  }
}

void add_ports(const ConfigSubject& subject, Section& section) {
  const daemon::LidarConfig defaults;
  const SensorFindings& sensor = *subject.sensor;
  if (sensor.data_port != defaults.port)
    section.add("port", std::to_string(sensor.data_port), "where the data packets go");
  if (sensor.telemetry && sensor.telemetry->port != defaults.position_port)
    section.add("position_port", std::to_string(sensor.telemetry->port), "where the telemetry goes");
  std::string others;
  for (const SensorFindings& other : subject.capture->sensors) {
    if (other.address != sensor.address && other.data_port == sensor.data_port)
      others += (others.empty() ? "" : ", ") + address_text(other.address);
  }
  if (!others.empty())
    section.add("sender_address", quoted(address_text(sensor.address)),
                "other sensors send to the same port: " + others);
}

void add_time(const ConfigSubject& subject, Section& section) {
  const SensorFindings& sensor = *subject.sensor;
  if (sensor.stats.time_jumps > 0 && sensor.stats.host_clock_jumps == 0) {
    section.add("time_source", quoted("host"),
                format("the sensor's clock was set %llu times while recording",
                       static_cast<unsigned long long>(sensor.stats.time_jumps)));
    return;
  }
  const bool gps = sensor.clock_source == core::ClockSource::kPpsLocked && sensor.telemetry &&
                   sensor.telemetry->nmea_valid > 0;
  // With an IMU both have to be on the recorder's clock.
  if (gps && sensor.clock && std::abs(sensor.clock->offset_s) > kClockWrongS && subject.can == nullptr) {
    section.add(
        "time_source", quoted("sensor"),
        "the sensor is locked to GPS, the recorder's clock is off by " + span_text(-sensor.clock->offset_s));
  }
}

void add_return_mode(const SensorFindings& sensor, Section& section) {
  if (sensor.stats.mode_changes <= kMostRealModeChanges) return;
  const char* mode = sensor.detection.mode == drivers::ReturnMode::kSingle ? "single"
                     : sensor.detection.mode == drivers::ReturnMode::kDual ? "dual"
                                                                           : "dual_confidence";
  section.add("return_mode", quoted(mode),
              format("as the recording begins; the packets seem to change it %llu times",
                     static_cast<unsigned long long>(sensor.stats.mode_changes)));
}

std::string imu_section(const CanFindings* can, const CaptureFindings& capture) {
  Section section("imu");
  if (can == nullptr) return "";
  const daemon::ImuConfig defaults;
  const ImuFindings* imu = can->imu();
  if (imu == nullptr) {
    section.add(
        "enabled", "false",
        "no built-in IMU's messages are in " + can->path + "; for an own device set dbc and map its signals");
    return section.text();
  }
  if (imu->preset != defaults.preset)
    section.add("preset", quoted(imu->preset),
                format("its messages are in the CAN log, %.1f Hz", imu->rate_hz()));
  if (can->interfaces.size() > 1)
    section.add("interface", quoted(imu->interface_name), "the IMU's; the log has frames of others too");
  const double apart_s = relate(*can, capture).apart_s;
  if (apart_s > 0.0) {
    section.note(can->path + " is not of the same time as the capture: they are " + span_text(apart_s) +
                 " apart, its samples will not be used");
  }
  return section.text();
}

}  // namespace

Result<ConfigSubject> choose_config_subject(const RecordingFindings& findings,
                                            const std::string& sensor_name) {
  ConfigSubject subject;
  std::string names;
  for (const CaptureFindings& capture : findings.captures) {
    for (const SensorFindings& sensor : capture.sensors) {
      if (!sensor.usable()) continue;
      const std::string address = address_text(sensor.address);
      const std::string full = address + ":" + std::to_string(sensor.data_port);
      names += (names.empty() ? "" : ", ") + full;
      if (!sensor_name.empty() && sensor_name != address && sensor_name != full) continue;
      if (subject.capture != nullptr && subject.capture != &capture)
        return Error{subject.capture->path + " and " + capture.path +
                     ": a configuration or calibration is made for one capture; name only that"};
      if (subject.sensor != nullptr && subject.sensor->packets >= sensor.packets) continue;
      subject.capture = &capture;
      subject.sensor = &sensor;
    }
  }
  if (subject.sensor == nullptr)
    return Error{names.empty() ? "no sensor to make a configuration or calibration for"
                               : "no sensor " + sensor_name + " is in the capture; there are " + names};
  for (const CanFindings& can : findings.can_logs) {
    if (!can.usable()) continue;
    if (subject.can != nullptr)
      return Error{subject.can->path + " and " + can.path +
                   ": a configuration is made for one CAN log; name only that"};
    subject.can = &can;
  }
  return subject;
}

std::string make_recording_config(const ConfigSubject& subject, const std::string& calibration_path) {
  Section lidar("lidar");
  add_model(*subject.sensor, lidar);
  add_calibration(*subject.sensor, calibration_path, lidar);
  add_ports(subject, lidar);
  add_return_mode(*subject.sensor, lidar);
  add_time(subject, lidar);
  std::string files = subject.capture->path;
  if (subject.can != nullptr) files += " and " + subject.can->path;
  return "# For " + comment_text(files) +
         ", made by nilio inspect.\n# Keys that are not here keep their defaults (niliod --help-config).\n" +
         lidar.text() + imu_section(subject.can, *subject.capture);
}

}  // namespace nilio::tools
