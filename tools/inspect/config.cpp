#include "tools/inspect/config.hpp"

#include "daemon/config/config.hpp"
#include "daemon/config/schema.hpp"
#include "tools/common/text.hpp"
#include "tools/inspect/report/report.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>
#include <vector>

namespace nilio::tools::inspect {

namespace {

using core::Error;
using core::Result;

/// Limit of niliod for a synchronised sensor clock.
constexpr double kClockWrongS = 0.2;
/// More changes than a user makes are misread packets, as where no return is received.
constexpr std::uint64_t kMostRealModeChanges = 5;

/// One line without control characters, for a YAML comment.
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
  explicit Section(std::string name) : name_(std::move(name)) {}
  /// `key` may have a group as prefix: "extrinsic.translation". Without a reason there is no comment.
  void add(const std::string& key, const std::string& value, const std::string& why) {
    keys_.insert(key);
    const auto dot = key.find('.');
    const std::string indent(dot == std::string::npos ? 2 : 4, ' ');
    std::string& lines = dot == std::string::npos ? lines_ : groups_[key.substr(0, dot)];
    if (!why.empty()) lines += indent + "# " + comment_text(why) + "\n";
    lines += indent + key.substr(dot == std::string::npos ? 0 : dot + 1) + ": " + value + "\n";
  }
  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] bool has(const std::string& key) const { return keys_.contains(key); }
  void note(const std::string& text) { notes_ += "  # " + comment_text(text) + "\n"; }
  /// Without keys only the notes.
  [[nodiscard]] std::string text() const {
    if (keys_.empty()) return notes_.empty() ? "" : "# " + name_ + ":\n" + notes_;
    std::string text = name_ + ":\n" + lines_;
    for (const auto& [group, lines] : groups_) text += "  " + group + ":\n" + lines;
    return text + notes_;
  }

 private:
  std::string name_;
  std::set<std::string> keys_;
  std::string lines_;
  std::map<std::string, std::string> groups_;
  std::string notes_;
};

void add_model(const SensorFindings& sensor, Section& section) {
  std::string why = sensor.detection.evidence;
  std::string others;
  for (const drivers::VelodyneModel model : sensor.detection.candidates) {
    if (model != *sensor.model)
      others += (others.empty() ? "" : " or ") + std::string(drivers::velodyne_model_name(model));
  }
  if (!others.empty()) why += "; if the label reads " + others + ", set that";
  section.add("model", quoted(std::string(drivers::velodyne_model_name(*sensor.model))), why);
  for (const std::string& hint : sensor.hints) section.note(hint);
}

void add_calibration(const SensorFindings& sensor, const std::string& path, Section& section) {
  if (!sensor.hdl64e) return;
  if (!path.empty()) {
    section.add("calibration", quoted(path), "the unit's own, from its status stream");
  } else if (sensor.hdl64e->calibration) {
    section.note("each HDL-64E has its own geometry: run nilio inspect with --write-calibration too");
  } else {
    section.note(
        "each HDL-64E has its own geometry, and the status stream here is incomplete: set calibration "
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
                format("the sensor's clock was set %llu times during the recording",
                       static_cast<unsigned long long>(sensor.stats.time_jumps)));
    return;
  }
  const bool gps = sensor.clock_source == core::ClockSource::kPpsLocked && sensor.telemetry &&
                   sensor.telemetry->nmea_valid > 0;
  // With an IMU both have to use the recorder's clock.
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
              format("as at the start of the recording; it seems to change %llu times in the packets",
                     static_cast<unsigned long long>(sensor.stats.mode_changes)));
}

/// Adds the keys that the drive was configured with, and its corrections. Keys that are present rest on the
/// packets and stay.
void add_configured(const DriveFindings& drive, std::vector<Section>& sections) {
  std::map<std::string, std::string> reasons;
  for (const CorrectedKey& key : corrected_keys(drive)) reasons[key.path] = key.why;
  daemon::Config config = corrected_config(drive);
  daemon::Config defaults;
  const std::vector<daemon::ConfigKey> keys = daemon::config_keys(config);
  const std::vector<daemon::ConfigKey> default_keys = daemon::config_keys(defaults);
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const std::string value = daemon::value_text(keys[i]);
    if (value == daemon::value_text(default_keys[i]) && !reasons.contains(keys[i].path)) continue;
    const auto dot = keys[i].path.find('.');
    const std::string name = keys[i].path.substr(0, dot);
    auto section =
        std::find_if(sections.begin(), sections.end(), [&](const Section& s) { return s.name() == name; });
    if (section == sections.end()) section = sections.insert(sections.end(), Section(name));
    const std::string key = keys[i].path.substr(dot + 1);
    const auto reason = reasons.find(keys[i].path);
    if (!section->has(key)) section->add(key, value, reason == reasons.end() ? "" : reason->second);
  }
}

void add_mounting(const LidarMounting& mounting, Section& section) {
  if (mounting.ground_scans == 0) {
    section.note("extrinsic: no ground was found in the scans; measure height, roll, pitch and yaw");
    return;
  }
  section.add("extrinsic.translation", numbers_text({0.0, 0.0, std::round(mounting.height_m * 1e3) * 1e-3}),
              format("height above ground in %llu scans (single scans +- %.3f m); base_link is on the ground "
                     "under the LiDAR: set x and y for another origin",
                     static_cast<unsigned long long>(mounting.ground_scans), mounting.height_deviation_m));
  std::string why =
      format("roll and pitch from the ground (single scans +- %.2f deg); ", mounting.slope_deviation_deg);
  if (mounting.is_yaw_observed()) {
    why += format(
        "yaw from %.0f m of straight driving, most of it (all but %.0f m) taken as forwards (each %.0f m +- "
        "%.2f deg): "
        "add 180 if the vehicle drove in reverse",
        mounting.straight_m, mounting.reversed_m, kStretchM, mounting.yaw_deviation_deg);
  } else if (mounting.is_direction_ambiguous()) {
    why += format(
        "yaw was not observed: of %.0f m of straight driving %.0f m went the other way, which does not tell "
        "forwards from reverse; drive forwards",
        mounting.straight_m, mounting.reversed_m);
  } else {
    why += format("yaw was not observed: %.0f m of straight driving, %.0f m are needed", mounting.straight_m,
                  kMinimumStraightM);
  }
  const auto hundredths = [](double value) { return std::round(value * 100.0) / 100.0; };
  const core::Vector3& rpy = mounting.rotation_rpy_deg;
  section.add("extrinsic.rotation_rpy_deg",
              numbers_text({hundredths(rpy.x()), hundredths(rpy.y()), hundredths(rpy.z())}), why);
}

Section imu_section(const CanFindings* can, const CaptureFindings& capture, bool for_vehicle) {
  Section section("imu");
  if (can == nullptr) return section;
  const daemon::ImuConfig defaults;
  const ImuFindings* imu = can->imu();
  if (imu == nullptr) {
    section.add("enabled", "false",
                "no built-in IMU's messages are in " + can->path +
                    "; for another device set dbc and map its signals");
    return section;
  }
  if (imu->preset != defaults.preset)
    section.add("preset", quoted(imu->preset),
                format("its messages are in the CAN log, %.1f Hz", imu->rate_hz()));
  if (can->interfaces.size() > 1 || for_vehicle)
    section.add("interface", quoted(imu->interface_name),
                can->interfaces.size() > 1 ? "the IMU's; the log has frames of others too" : "the IMU's");
  const double apart_s = relate(*can, capture).apart_s;
  if (apart_s > 0.0) {
    section.note(can->path + " and the capture do not overlap: they are " + span_text(apart_s) +
                 " apart, its samples are not used");
  }
  return section;
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

std::string make_recording_config(const ConfigSubject& subject, const ConfigParts& parts) {
  Section lidar("lidar");
  add_model(*subject.sensor, lidar);
  add_calibration(*subject.sensor, parts.calibration_path, lidar);
  add_ports(subject, lidar);
  add_return_mode(*subject.sensor, lidar);
  add_time(subject, lidar);
  if (parts.mounting != nullptr) add_mounting(*parts.mounting, lidar);
  std::vector<Section> sections{std::move(lidar)};
  // A configuration given for the drive takes precedence over the contents of the log.
  const bool is_from_log =
      parts.drive == nullptr ||
      (parts.drive->config_path.empty() && subject.can != nullptr && subject.can->imu() != nullptr);
  sections.push_back(is_from_log ? imu_section(subject.can, *subject.capture, parts.mounting != nullptr)
                                 : Section("imu"));
  if (parts.drive != nullptr) add_configured(*parts.drive, sections);
  std::string text;
  for (const Section& section : sections) text += section.text();
  std::string files = subject.capture->path;
  if (subject.can != nullptr) files += " and " + subject.can->path;
  return "# For " + comment_text(parts.source.empty() ? files : parts.source) + ", made by nilio " +
         (parts.mounting != nullptr ? "init" : "inspect") +
         ".\n# Keys that are not here keep their defaults (niliod --help-config).\n" + text;
}

}  // namespace nilio::tools::inspect
