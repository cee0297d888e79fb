#include "daemon/input/sensor_identification.hpp"

#include "nilio/drivers/velodyne/model.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "daemon/config/convert.hpp"

#include <chrono>
#include <cstdio>
#include <fstream>
#include <string_view>
#include <utility>
#include <variant>

namespace nilio::daemon {

namespace {

using core::Error;
using core::Result;
using drivers::kHdl64eStatusPackets;

// Two passes contain one whole pass, wherever the stream is joined.
constexpr std::size_t kStreamPackets = 2 * kHdl64eStatusPackets;
// Every packet may arrive twice.
constexpr std::size_t kReceivedPackets = 2 * kStreamPackets - kDetectionPackets;
// Types of the status bytes repeated in every cycle; the others carry the calibration table.
constexpr std::string_view kClockTypes = "HMSDNYGTV";

std::string candidate_names(const drivers::VelodyneDetection& detection) {
  std::string names;
  for (const drivers::VelodyneModel model : detection.candidates)
    names += (names.empty() ? "" : " or ") + std::string(drivers::velodyne_model_name(model));
  return names;
}

Result<drivers::VelodyneModel> choose_model(const LidarConfig& config, const std::string& section,
                                            const drivers::VelodyneDetection& detection) {
  const std::string key = section + ".model";
  if (config.model == "auto") {
    if (detection.model) return *detection.model;
    const std::string seen = " (" + detection.evidence + ")";
    if (!detection.candidates.empty())
      return Error{"sensor identified as " + candidate_names(detection) + seen + " - select one with " + key};
    return Error{"sensor model cannot be identified from the packets" + seen + ": set " + key};
  }
  const std::optional<drivers::VelodyneModel> wanted = drivers::parse_velodyne_model(config.model);
  if (!wanted) return Error{key + " '" + config.model + "' is not a known model"};
  return *wanted;
}

/// Why the packets make the model doubtful; empty if they do not.
std::string doubts_about_model(const LidarConfig& config, const std::string& section,
                               const drivers::VelodyneDetection& detection) {
  const std::string key = section + ".model";
  if (config.model == "auto") {
    if (!detection.model || detection.uncertainty.empty()) return "";
    return section + ": the model is uncertain: " + candidate_names(detection) + " (" + detection.evidence +
           "; " + detection.uncertainty + "); decoded as " +
           std::string(drivers::velodyne_model_name(*detection.model)) + " - set " + key +
           " to the right one";
  }
  const std::optional<drivers::VelodyneModel> wanted = drivers::parse_velodyne_model(config.model);
  if (!wanted || detection.candidates.empty() || detection.agrees_with(*wanted)) return "";
  return key + " is " + config.model + ", but the packets look like those of " + candidate_names(detection) +
         " (" + detection.evidence + "); decoded as " + config.model +
         " - correct it, or set it to auto, if scans are missing or distorted";
}

/// Empty unless the packets show another return mode than the configured one.
std::string wrong_return_mode(const LidarConfig& config, const std::string& section,
                              const drivers::VelodyneDetection& detection) {
  const std::optional<drivers::ReturnMode> wanted = assembler_config(config).return_mode;
  if (!wanted || !detection.mode_known || *wanted == detection.mode) return "";
  const std::string name(drivers::return_mode_name(detection.mode));
  return section + ".return_mode is " + config.return_mode + ", but the packets have " + name + " returns (" +
         detection.evidence + ") - set it to auto or to the sensor's mode";
}

/// Empty unless the model lacks the configured return mode.
std::string missing_return_mode(const LidarConfig& config, const std::string& section,
                                const drivers::VelodyneSensor& sensor) {
  const std::optional<drivers::ReturnMode> wanted = assembler_config(config).return_mode;
  if (!wanted || sensor.layout(*wanted) != nullptr) return "";
  return section + ".return_mode is " + config.return_mode + ", which the " + sensor.name +
         " does not have - set it to auto";
}

Result<drivers::VelodyneSensor> make_sensor(drivers::VelodyneModel model, const LidarConfig& config) {
  drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(model);
  if (config.azimuth_interpolation != "auto")
    drivers::set_azimuth_interpolation(sensor, config.azimuth_interpolation == "on");
  if (config.calibration.empty()) return sensor;
  return drivers::with_calibration_file(std::move(sensor), config.calibration);
}

std::string date_text(core::Time time) {
  const std::chrono::sys_time<std::chrono::nanoseconds> point{std::chrono::nanoseconds(time.ns)};
  const std::chrono::year_month_day date{std::chrono::floor<std::chrono::days>(point)};
  char text[32];
  std::snprintf(text, sizeof text, "%04d-%02u-%02u", static_cast<int>(date.year()),
                static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()));
  return text;
}

/// Errors of the configuration that need no packets.
Result<drivers::VelodyneSensor> make_configured_sensor(const LidarConfig& config,
                                                       const std::string& section) {
  const std::optional<drivers::VelodyneModel> model = drivers::parse_velodyne_model(config.model);
  if (!model) return Error{section + ".model '" + config.model + "' is not a known model"};
  Result<drivers::VelodyneSensor> sensor = make_sensor(*model, config);
  if (!sensor) return sensor;
  const std::string problem = missing_return_mode(config, section, *sensor);
  if (!problem.empty()) return Error{problem};
  return sensor;
}

std::string list_of(const std::vector<std::uint16_t>& numbers) {
  std::string text;
  for (const std::uint16_t number : numbers) text += (text.empty() ? "" : ", ") + std::to_string(number);
  return text;
}

}  // namespace

SensorIdentification::SensorIdentification(const LidarConfig& config, std::string section)
    : config_(config), section_(std::move(section)) {
  sample_.reserve(kDetectionPackets);
}

SensorIdentification::State SensorIdentification::add(const drivers::Packet& packet) {
  if (!drivers::is_data_packet(packet)) return State::kUndecided;
  ++packets_received_;
  if (sensor_) {
    order_->add(packet);
    return read_stream();
  }
  sample_.push_back(packet);
  return sample_.size() < kDetectionPackets ? State::kUndecided : decide_model();
}

SensorIdentification::State SensorIdentification::finish() {
  State state = sensor_ ? State::kUndecided : decide_model();
  if (state == State::kUndecided) state = use_built_in("too few packets");
  return state;
}

SensorIdentification::State SensorIdentification::reject(const std::string& problem) {
  problem_ = problem;
  sample_.clear();
  packets_received_ = 0;
  return State::kRejected;
}

std::string SensorIdentification::model_text() const {
  std::string text = "LiDAR " + sensor_->name;
  if (config_.model != "auto") return text;
  text += " (from the packets";
  if (sensor_->lasers.size() == drivers::kHdl64eLasers && detection_.candidates.size() > 1)
    text += ", which " + candidate_names(detection_) + " send alike";
  return text + ")";
}

SensorIdentification::State SensorIdentification::decide_model() {
  detection_ = drivers::detect_velodyne(sample_);
  const Result<drivers::VelodyneModel> model = choose_model(config_, section_, detection_);
  if (!model) return reject(model.error().message);
  Result<drivers::VelodyneSensor> sensor = make_sensor(*model, config_);
  if (!sensor) return reject(sensor.error().message);
  for (const std::string& problem :
       {missing_return_mode(config_, section_, *sensor), wrong_return_mode(config_, section_, detection_)}) {
    if (!problem.empty()) return reject(problem);
  }
  sensor_ = std::move(sensor).value();
  const bool is_hdl64e = sensor_->lasers.size() == drivers::kHdl64eLasers;
  const std::string doubts = doubts_about_model(config_, section_, detection_);
  // Its own calibration makes the generations of the HDL-64E alike.
  if (!doubts.empty() && !(is_hdl64e && config_.model == "auto")) warnings_.push_back(doubts);
  if (!config_.calibration.empty()) {
    notes_.push_back(model_text() + ", calibration " + config_.calibration);
    const std::vector<std::uint16_t> disabled = drivers::disabled_lasers(*sensor_);
    if (!disabled.empty()) notes_.push_back(config_.calibration + " disables laser " + list_of(disabled));
    return State::kIdentified;
  }
  if (!is_hdl64e) {
    notes_.push_back(model_text());
    return State::kIdentified;
  }
  order_.emplace(sensor_->has_clock ? 1e-3 * static_cast<double>(sensor_->single().packet_period_ns) : 0.0);
  for (const drivers::Packet& packet : std::exchange(sample_, {})) order_->add(packet);
  return read_stream();
}

SensorIdentification::State SensorIdentification::read_stream() {
  State state = State::kUndecided;
  bool after_loss = false;
  while (state == State::kUndecided) {
    const std::optional<StatusByte> byte = order_->next(after_loss);
    if (!byte) break;
    state = read_status(*byte, after_loss);
  }
  if (state == State::kUndecided && packets_received_ >= kReceivedPackets)
    state = use_built_in("packets are missing");
  return state;
}

SensorIdentification::State SensorIdentification::read_status(const StatusByte& byte, bool after_loss) {
  if (after_loss) {
    stream_.note_loss();
    ++stream_losses_;
  }
  stream_.add(byte.type, byte.value);
  if (stream_.calibration()) return use_stream(*stream_.calibration());
  const drivers::Hdl64eStatusCounters& counters = stream_.counters();
  ++stream_packets_;
  if (byte.value != 0 && kClockTypes.find(static_cast<char>(byte.type)) == std::string_view::npos)
    carries_table_ = true;
  // Converted recordings have only a clock there, or no status bytes.
  const bool is_empty = !carries_table_ || (counters.cycles == 0 && stream_losses_ == 0);
  if (stream_packets_ >= kHdl64eStatusPackets && is_empty) return use_built_in("no calibration in it");
  if (stream_packets_ < kStreamPackets) return State::kUndecided;
  if (counters.wrong_crc + counters.implausible > 0)
    return use_built_in("wrong checksum or implausible values");
  return use_built_in("packets are missing");
}

SensorIdentification::State SensorIdentification::use_stream(const drivers::Hdl64eCalibration& calibration) {
  Result<drivers::VelodyneSensor> sensor = drivers::with_stream_calibration(*sensor_, calibration);
  if (!sensor) return use_built_in(sensor.error().message);
  sensor_ = std::move(sensor).value();
  const std::optional<core::Time> date = calibration.unit.calibrated;
  notes_.push_back(model_text() + ", calibration from its own status stream (unit calibrated " +
                   (date ? "on " + date_text(*date) : "on an unknown date") + ")");
  if (calibration.checksum == drivers::Hdl64eChecksum::kNone) {
    warnings_.push_back(
        section_ +
        ": the calibration from the status stream has no checksum: corrupted values are not detected - "
        "compare it with the unit's db.xml");
  }
  return State::kIdentified;
}

SensorIdentification::State SensorIdentification::use_built_in(const std::string& reason) {
  notes_.push_back(model_text() + ", built-in geometry");
  warnings_.push_back(
      section_ + ": every " + sensor_->name +
      " needs its own calibration; the built-in one belongs to another unit, and the status stream "
      "provides none (" +
      reason + "): set " + section_ +
      ".calibration to the unit's db.xml, or to a file from 'nilio inspect "
      "--write-calibration' of a recording");
  return State::kIdentified;
}

std::optional<drivers::VelodyneSensor> configured_sensor(const LidarConfig& config) {
  if (config.model == "auto") return std::nullopt;
  Result<drivers::VelodyneSensor> sensor = make_configured_sensor(config, "");
  if (!sensor) return std::nullopt;
  if (sensor->lasers.size() == drivers::kHdl64eLasers && config.calibration.empty()) return std::nullopt;
  return std::move(sensor).value();
}

Result<std::monostate> check_lidar(const LidarConfig& config, const std::string& section) {
  if (config.model != "auto") {
    const Result<drivers::VelodyneSensor> sensor = make_configured_sensor(config, section);
    if (!sensor) return sensor.error();
  } else if (!config.calibration.empty() && !std::ifstream(config.calibration)) {
    return Error{config.calibration + ": cannot be read: check " + section + ".calibration"};
  }
  return std::monostate{};
}

}  // namespace nilio::daemon
